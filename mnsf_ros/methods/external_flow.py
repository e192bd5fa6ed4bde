# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Flow from outside: by another program for each sweep (`command:LINE`), or in files (`file:DIR`).

Learned networks run so, in an environment of their own and with the user's weights. The formats are
in `docs/evaluation.md`.
"""

import os
import re
import shlex
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.errors import DatasetError, MethodError, SettingsError
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import fit_mask
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps_io.files import read_npz

_TIMEOUT_S: Final = 600.0
_TIME_LINE: Final = re.compile(r"^time_ms: ([0-9.eE+]+)\s*$", re.MULTILINE)
_MAX_MESSAGE: Final = 300


class CommandEstimator:
    """Runs another program to estimate the flow of the kept points.

    Other points get zero flow, or NaN where the caller has marked the points that it asks for.
    """

    traits = MethodTraits(is_external=True)

    def __init__(self, line: str, settings: Settings) -> None:
        """Makes an estimator of a command line, quoted as for a shell.

        Raises:
            SettingsError: If there is no command, or a quote is not closed.
        """
        try:
            self._command = shlex.split(line)
        except ValueError as error:
            raise SettingsError(f"method command {line!r}: {error}") from error
        if not self._command:
            raise SettingsError(f"method command {line!r}: expected a program and its arguments")
        self._line, self.settings = line, settings

    @classmethod
    def from_environment(cls, method: str, settings: Settings) -> "CommandEstimator":
        """Makes an estimator of the command in the environment variable of a learned network.

        Raises:
            SettingsError: If the variable is not set, or holds no command.
        """
        variable = f"MNSF_{method.upper()}"
        if not (line := os.environ.get(variable, "").strip()):
            raise SettingsError(
                f"method {method!r} runs the command in the environment variable {variable}, "
                "which is not set; see docs/evaluation.md"
            )
        return cls(line, settings)

    def renewed(self, settings: Settings) -> "CommandEstimator":
        """Returns the same command with other settings."""
        return CommandEstimator(self._line, settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep.
            MethodError: If the program cannot be started, fails, takes too long, or writes no
                finite flow for each point.
        """
        clock = StageClock()
        with clock.stage("prepare"):
            kept, next_kept = (
                fit_mask(sweep, self.settings) for sweep in (triplet.current, triplet.next)
            )
        with clock.stage("command"):
            points = triplet.current.xyz[kept], triplet.next.xyz[next_kept]
            kept_flow, output = self._run(*points)
        elsewhere = 0.0 if triplet.current.kept is None else np.nan
        flow = np.full_like(triplet.current.xyz, elsewhere)
        flow[kept] = kept_flow
        times = _TIME_LINE.findall(output)
        times_ms = {"network": float(times[-1])} if times else clock.times_ms
        return FlowEstimate(flow, kept, times_ms)

    def _run(self, current: Floats32, following: Floats32) -> tuple[Floats32, str]:
        """The flow that the program writes, and its standard output."""
        with tempfile.TemporaryDirectory(prefix="mnsf_") as folder:
            files = [Path(folder, f"{name}.npy") for name in ("current", "next", "flow")]
            np.save(files[0], current)
            np.save(files[1], following)
            output = _output([*self._command, *map(str, files)])
            program = self._command[0]
            try:
                flow = _checked(np.load(files[2], allow_pickle=False), len(current), program)
            except FileNotFoundError as error:
                raise MethodError(f"{program}: wrote no flow.npy") from error
            except (OSError, ValueError, EOFError) as error:
                raise MethodError(f"{program}: flow.npy cannot be read: {error}") from error
        num_bad = int(np.count_nonzero(~np.isfinite(flow).all(axis=1)))
        if num_bad:
            raise MethodError(f"{program}: {num_bad} of {len(flow)} rows of flow are not finite")
        return flow, output


def _output(command: list[str]) -> str:
    """Standard output of a program that ends well."""
    program = command[0]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_TIMEOUT_S,
            check=False,
        )
    except OSError as error:
        raise MethodError(f"{program}: cannot be started: {error.strerror}") from error
    except subprocess.TimeoutExpired as error:
        raise MethodError(f"{program}: not done after {_TIMEOUT_S:g} s") from error
    if done.returncode:
        last = ((done.stderr or done.stdout).strip().splitlines() or ["no output"])[-1]
        raise MethodError(f"{program}: ended with status {done.returncode}: {last[:_MAX_MESSAGE]}")
    return done.stdout


class PredictionFiles:
    """Looks flow up instead of estimating it."""

    traits = MethodTraits(is_external=True, is_timed=False)

    def __init__(self, folder: str, settings: Settings) -> None:
        """Names the folder of the predictions; the settings are not used.

        Raises:
            SettingsError: There is no such folder.
        """
        self._folder, self.settings = Path(folder), settings
        if not folder or not self._folder.is_dir():
            raise SettingsError(f"file:{folder}: there is no such folder of predictions")

    def renewed(self, settings: Settings) -> "PredictionFiles":
        """Returns the same with other settings."""
        return PredictionFiles(str(self._folder), settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Returns the predicted flow of the current sweep, which must be a recorded one.

        Raises:
            MethodError: There is no prediction, or it does not fit the sweep.
        """
        current = triplet.current
        # The points of a recorded sweep know their rows in its cloud.
        cloud: Any = current.source
        if not getattr(cloud, "recording", ""):
            raise MethodError("predictions from files are of recorded sweeps only")
        file = self._file_of(current)
        try:
            flow = _checked(read_npz(file, ["flow"])["flow"], cloud.num_points, str(file))
        except DatasetError as error:
            raise MethodError(str(error)) from error
        # Only the points whose flow is asked for need a finite prediction.
        asked = np.ones(len(current), dtype=bool) if current.kept is None else current.kept
        return FlowEstimate(flow[cloud.rows], kept=asked)

    def _file_of(self, sweep: Sweep) -> Path:
        # A name that is a whole path leads nowhere but into the folder.
        parts = [part for part in Path(sweep.source.recording).parts if part not in ("/", "..")]
        places = [
            parent / f"{sweep.stamp_ns}.npz"
            for parent in (self._folder.joinpath(*parts), self._folder)
        ]
        for place in places:
            if place.is_file():
                return place
        raise MethodError(
            f"{self._folder}: no prediction for stamp {sweep.stamp_ns}; expected for example "
            f"{places[0]}"
        )


def _checked(flow: NDArray[Any], num_points: int, source: str) -> Floats32:
    """The flow as (N, 3) float32; MethodError unless it has three numbers for each point."""
    if flow.shape != (num_points, 3) or flow.dtype.kind not in "fiu":
        raise MethodError(
            f"{source}: flow has shape {flow.shape} of {flow.dtype}, expected ({num_points}, 3) "
            "numbers, a row for each point"
        )
    with np.errstate(over="ignore"):
        return flow.astype(np.float32)
