# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The record of a run: options, methods, recordings, and the facts of its sessions."""

import datetime
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from mnsf_ros import __version__
from mnsf_ros.errors import EvaluationError, plain_text
from mnsf_ros.evaluation.options import SET_BY_EVALUATOR, EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.task import FinishedTask
from mnsf_ros.presets import nearest_preset, settings_for
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings

_PACKAGES: Final = ("torch", "numpy", "scipy", "edt", "rosbags", "mcap")
_GIT_TIMEOUT_S: Final = 10
# Another preset changes dozens of settings.
_MAX_CHANGES: Final = 5

# Time, command line, versions, machine and commit of one start of a run: name to text.
Session = dict[str, str]


def session_now(arguments: Sequence[str]) -> Session:
    """Returns the facts of a session that starts now; the GPU only if PyTorch is loaded."""
    parts = (platform.node(), _processor(), f"{os.cpu_count()} cores", _gpu())
    return {
        "started": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "command": shlex.join(map(plain_text, arguments)),
        "machine": ", ".join(filter(None, parts)),
        "system": platform.platform(),
        "mnsf_ros": __version__,
        "git commit": _git_commit(),
        "python": platform.python_version(),
        **{package: _version(package) for package in _PACKAGES},
    }


@dataclass(frozen=True)
class RunRecord:
    """Options, methods, recordings and sessions of a run."""

    options: EvaluationOptions
    methods: list[EvaluatedMethod]  # in the order of the tables
    recordings: list[EvaluatedRecording]
    sessions: list[Session]  # at least one
    finished: list[FinishedTask] = field(default_factory=list)

    @property
    def method_names(self) -> list[str]:
        """Names of the methods, in the order of the tables."""
        return [method.name for method in self.methods]

    @property
    def references(self) -> frozenset[str]:
        """Names of the methods that are only references for comparison."""
        return frozenset(method.name for method in self.methods if method.traits.is_reference)

    def used_settings(self, method: str) -> tuple[Settings, str, dict[str, SettingValue]]:
        """Returns the settings of a method, the nearest preset, and the settings that differ.

        Explicit settings count as different whatever their values; those of the evaluator never.
        """
        own = settings_for(method, self.options.settings)
        return own, *nearest_preset(own, SET_BY_EVALUATOR, own.explicit)

    def resuming(self, before: "RunRecord", folder: Path) -> "RunRecord":
        """Returns the record of a resumed run, which may have more recordings and methods.

        Raises:
            EvaluationError: The settings, or a recording of the same name, differ.
        """
        if changes := _differences(before.options.identity, self.options.identity):
            raise EvaluationError(f"{folder}: holds a run with other settings: {changes}")
        recordings = {recording.name: recording for recording in before.recordings}
        for new in self.recordings:
            old = recordings.get(new.name, new)
            if changes := _differences(old.identity, new.identity):
                raise EvaluationError(f"{folder}: holds another recording {new.name!r}: {changes}")
            recordings[new.name] = new
        return RunRecord(
            options=before.options,
            methods=list({one.name: one for one in (*before.methods, *self.methods)}.values()),
            recordings=list(recordings.values()),
            sessions=[*before.sessions, *self.sessions],
            finished=before.finished,
        )


def _differences(before: Mapping[str, object], now: Mapping[str, object]) -> str:
    """Returns the first few changes as text; empty if there are none."""
    names = [name for name in sorted({*before, *now}) if before.get(name) != now.get(name)]
    # It differs alone where a setting was set to its default.
    names = [name for name in names if name != "explicit"] or names
    parts = [f"{name} was {before.get(name)}, is {now.get(name)}" for name in names[:_MAX_CHANGES]]
    if (more := len(names) - len(parts)) > 0:
        parts.append(f"and {more} more")
    return "; ".join(parts)


def _git_commit() -> str:
    """Commit, with `+changes` if there are any; empty if this package is not in a checkout."""
    is_stored = _git("ls-files", "--error-unmatch", __file__)
    describe = ("describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+changes")
    return _git(*describe) if is_stored else ""


def _git(*arguments: str) -> str:
    """Output of a git command, empty if it fails."""
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    try:
        return subprocess.check_output(
            command, stderr=subprocess.DEVNULL, text=True, timeout=_GIT_TIMEOUT_S
        ).strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _gpu() -> str:
    """Name of the GPU, empty without one. PyTorch is not imported here: that takes seconds."""
    torch = sys.modules.get("torch")
    return torch.cuda.get_device_name() if torch and torch.cuda.is_available() else ""


def _processor() -> str:
    """Name of the processor; `platform.processor` is empty on most Linux systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())
