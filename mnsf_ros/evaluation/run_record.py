"""What a run was: settings, seed, versions, machine and commit, so that it can be trusted."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import torch

from mnsf_ros import __version__
from mnsf_ros.evaluation.options import (
    ALL_POINTS,
    EvaluatedRecording,
    EvaluationOptions,
    PointSelection,
)
from mnsf_ros.evaluation.path_text import path_text
from mnsf_ros.recording.fingerprint import fingerprint

_PACKAGES: Final = ("torch", "numpy", "scipy", "edt", "rosbags", "mcap")
_GIT_TIMEOUT_S: Final = 10


def identity(options: EvaluationOptions) -> dict[str, Any]:
    """Returns all that rows depend on, apart from recording and method, ready for JSON.

    Two runs with the same identity may put their rows together.
    """
    selection: PointSelection = options.selection
    return {
        "settings": dict(options.method_settings.to_mapping()),
        "crop_and_ground": {
            name: value
            for name, value in options.settings.to_mapping().items()
            if name.startswith(("crop.", "ground."))
        },
        "num_points": ALL_POINTS if selection.num_points is None else selection.num_points,
        "seed": options.seed,
        "ground": "truth" if selection.use_true_ground else "settings",
        "realtime_rate": options.realtime_rate,
        "check_cycle": options.check_cycle,
        "num_sweeps": options.num_sweeps,
        "every": options.every,
    }


def recording_record(recording: EvaluatedRecording) -> dict[str, Any]:
    """Returns what is to be remembered of a recording, ready for JSON.

    Raises:
        OSError: It cannot be read any more.
    """
    inspection = recording.inspection
    return {
        "name": recording.name,
        "path": str(inspection.path.resolve()),
        "fingerprint": fingerprint(inspection.path),
        "points": recording.points,
        "truth": recording.truth,
        "odometry": recording.odometry,
        "num_sweeps": recording.num_sweeps,
        "has_checksums": inspection.has_checksums,
        "damages": [path_text(str(damage)) for damage in inspection.damages],
    }


def session_record(arguments: Sequence[str]) -> dict[str, Any]:
    """Returns when, where and by what a run was started, ready for JSON."""
    return {
        "started": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "command": [path_text(argument) for argument in arguments],
        "versions": _versions(),
        "machine": machine(),
        "git_commit": git_commit(),
    }


def machine() -> dict[str, Any]:
    """Returns what this machine is, ready for JSON."""
    return {
        "name": platform.node(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
    }


def git_commit() -> str | None:
    """Returns the commit of this package's checkout, with `+changes` if there are any.

    None if the package is not in a checkout of its own, for example installed from a wheel.
    """
    here = Path(__file__)
    if _git(here.parent, "ls-files", "--error-unmatch", here.parent.parent.joinpath("errors.py")):
        commit = _git(here.parent, "rev-parse", "HEAD")
        changes = _git(here.parent, "status", "--porcelain", "--untracked-files=no")
        return f"{commit}+changes" if changes else commit or None
    return None


def _git(folder: Path, *arguments: str | Path) -> str:
    """Output of a git command, empty if it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", folder, *arguments],
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _versions() -> dict[str, str]:
    installed = {package: _version(package) for package in _PACKAGES}
    return {"mnsf_ros": __version__, "python": sys.version.split()[0], **installed}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    """Name of the processor; `platform.processor` is empty on most Linux systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())
