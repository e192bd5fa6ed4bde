# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Methods that are other programs, such as learned networks with the user's weights.

The command gets three more arguments, CURRENT.npy, NEXT.npy and FLOW.npy. The first two are
float32 (N, 3) and (M, 3), metres, the cropped sweeps without ground. It must write the third,
(N, 3) metres: row i is the motion of point i until the next sweep, in the sensor's frames as they
are. The last line `time_ms: 12.5` on its standard output is the run time of the network; without
one, that of the whole program counts.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock
from mnsf_ros.core.prepared_sweep import SweepPreparation
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.errors import MethodError, SettingsError
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_TIMEOUT_S = 600.0
_TIME_LINE = re.compile(r"^time_ms: ([0-9.eE+]+)\s*$", re.MULTILINE)
_MAX_MESSAGE = 300


class CommandEstimator:
    """Runs another program to estimate the flow of the kept points.

    Other points get zero flow, or NaN where the caller has marked the points that it asks for.
    """

    traits = MethodTraits(is_external=True)

    def __init__(
        self, command: Sequence[str], settings: Settings, timeout_s: float = _TIMEOUT_S
    ) -> None:
        """Makes an estimator.

        Args:
            command: Program and arguments, to which the three files are added. No shell.
            settings: Crop, ground and maximum number of points.
            timeout_s: Limit of the program's run time, seconds.
        """
        # The points go into files.
        self.settings = settings.changed({"compute.device": "cpu"})
        self._preparation = SweepPreparation(self.settings)
        self._command = list(command)
        self._timeout_s = timeout_s

    @classmethod
    def from_text(cls, text: str, settings: Settings) -> CommandEstimator:
        """Makes an estimator of a command line, quoted as for a shell.

        Raises:
            SettingsError: If there is no command, or a quote is not closed.
        """
        try:
            command = shlex.split(text)
        except ValueError as error:
            raise SettingsError(f"method command {text!r}: {error}") from error
        if not command:
            raise SettingsError(f"method command {text!r}: expected a program and its arguments")
        return cls(command, settings)

    @classmethod
    def from_environment(cls, method: str, settings: Settings) -> CommandEstimator:
        """Makes an estimator of the command in the environment variable of a learned network.

        Raises:
            SettingsError: If the variable is not set, or holds no command.
        """
        variable = f"MNSF_{method.upper()}"
        text = os.environ.get(variable, "")
        if not text.strip():
            raise SettingsError(
                f"method {method!r} runs the command in the environment variable {variable}, "
                "which is not set; see docs/evaluation.md"
            )
        return cls.from_text(text, settings)

    def with_settings(self, settings: Settings) -> CommandEstimator:
        """Returns the same command with other settings."""
        return CommandEstimator(self._command, settings, self._timeout_s)

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
            current, following = self._preparation.prepare(triplet.current, triplet.next)
        with clock.stage("command"):
            sweeps = (current.points.numpy(), following.points.numpy())
            kept_flow, output = self._run(*sweeps)
        elsewhere = 0.0 if triplet.current.kept is None else np.nan
        flow = np.full_like(triplet.current.xyz, elsewhere)
        flow[current.kept] = kept_flow
        times = _TIME_LINE.findall(output)
        times_ms = {"network": float(times[-1])} if times else clock.times_ms
        return FlowEstimate(flow, current.kept, times_ms)

    def _run(
        self, current: NDArray[np.float32], following: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], str]:
        with tempfile.TemporaryDirectory(prefix="mnsf_") as folder:
            files = [Path(folder, f"{name}.npy") for name in ("current", "next", "flow")]
            np.save(files[0], current)
            np.save(files[1], following)
            output = self._output([*self._command, *map(str, files)])
            return self._read(files[2], len(current)), output

    def _output(self, command: list[str]) -> str:
        program = self._command[0]
        try:
            status, output, complaint = _ended(command, self._timeout_s)
        except OSError as error:
            raise MethodError(f"{program}: cannot be started: {error.strerror}") from error
        except subprocess.TimeoutExpired as error:
            raise MethodError(f"{program}: not done after {self._timeout_s:g} s") from error
        if status:
            lines = (complaint or output).strip().splitlines() or ["no output"]
            last = lines[-1][:_MAX_MESSAGE]
            raise MethodError(f"{program}: ended with status {status}: {last}")
        return output

    def _read(self, file: Path, num_points: int) -> NDArray[np.float32]:
        program = self._command[0]
        try:
            flow: NDArray[Any] = np.load(file, allow_pickle=False)
        except FileNotFoundError as error:
            raise MethodError(f"{program}: wrote no flow.npy") from error
        except (OSError, ValueError, EOFError) as error:
            raise MethodError(f"{program}: flow.npy cannot be read: {error}") from error
        if flow.shape != (num_points, 3) or flow.dtype.kind not in "fiu":
            raise MethodError(
                f"{program}: flow.npy has shape {flow.shape} of {flow.dtype}, expected "
                f"({num_points}, 3) numbers"
            )
        with np.errstate(over="ignore"):
            flow = flow.astype(np.float32)
        num_bad = int(np.count_nonzero(~np.isfinite(flow).all(axis=1)))
        if num_bad:
            raise MethodError(f"{program}: {num_bad} of {num_points} rows of flow are not finite")
        return flow


def _ended(command: list[str], timeout_s: float) -> tuple[int, str, str]:
    """Exit status, output and error output of a program that has ended."""
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            output, complaint = process.communicate(timeout=timeout_s)
        except BaseException:
            # Not only the program: what it started would keep the GPU, and us waiting.
            os.killpg(process.pid, signal.SIGKILL)
            raise
        return process.returncode, output, complaint
