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
