# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The scene flow node as a child process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from mnsf_ros.errors import MnsfError

_STOP_TIMEOUT_S = 10.0
_LINES_SHOWN = 5


class NodeProcessError(MnsfError):
    """The node's process ended by itself or did not start."""


class NodeProcess:
    """A running node."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        self._process = process
        self._log = log

    def check(self) -> None:
        """Checks that the node still runs.

        Raises:
            NodeProcessError: If it has ended; with the last lines of its log.
        """
        status = self._process.poll()
        if status is not None:
            raise self.failure(f"the node ended with exit status {status}")

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def memory_mb(self) -> float:
        """Peak memory of the process; NaN where the system does not tell."""
        return self._status_mb("VmHWM")

    @property
    def resident_mb(self) -> float:
        """Memory of the process now; NaN where the system does not tell."""
        return self._status_mb("VmRSS")

    @property
    def cpu_s(self) -> float:
        """CPU time of all its threads so far; NaN where the system does not tell."""
        stat = Path(f"/proc/{self._process.pid}/stat")
        if not stat.exists():
            return float("nan")
        # The name before the last bracket may have spaces in it.
        user, system = stat.read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def _status_mb(self, name: str) -> float:
        status = Path(f"/proc/{self._process.pid}/status")
        lines = status.read_text().splitlines() if status.exists() else []
        values = [float(line.split()[1]) / 1e3 for line in lines if line.startswith(name)]
        return values[0] if values else float("nan")

    def failure(self, what: str) -> NodeProcessError:
        """An error with the last lines of the node's log."""
        lines = self._log.read_text(errors="replace").strip().splitlines()[-_LINES_SHOWN:]
        said = " | ".join(line.strip() for line in lines) or "nothing"
        return NodeProcessError(f"{what}; it said: {said} ({self._log})")


@contextmanager
def node_process(arguments: Sequence[str], log: Path) -> Iterator[NodeProcess]:
    """Runs the node with arguments after `--ros-args`; its log goes into a file."""
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", "mnsf_ros.node", "--ros-args", *arguments],
            stdout=stream,
            stderr=subprocess.STDOUT,
            env=dict(os.environ),
            # Ctrl-C in the terminal is for the demo, which then ends the node in good order.
            start_new_session=True,
        )
        try:
            yield NodeProcess(process, log)
        finally:
            process.send_signal(signal.SIGINT)  # does nothing if it has ended
            try:
                process.wait(_STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
