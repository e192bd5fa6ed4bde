# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Runs of `mnsf evaluate` on a small recording, for `reliability_ends.py`."""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

from mnsf_ros.cli.main import main, run
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

_TIMEOUT_S: Final = 300
# The process that starts workers ends when it has imported what they need.
_LEFT_S: Final = 120
_FORK: Final = multiprocessing.get_context("fork")

Rows = dict[tuple[str, int], Any]


class Evaluations:
    """Runs of `mnsf evaluate` on a small recording, in processes that have imported it already.

    Attributes:
        folder: Where to work.
        out: Folder of results.
        duration_s: How long a whole run takes.
    """

    def __init__(self, folder: Path) -> None:
        """Writes the recording, and evaluates it once in this process and once in another one."""
        self.folder, self.out = folder, folder / "out"
        settings = SimulationSettings(duration_s=1.2, num_beams=16, num_columns=180)
        write_recording(settings, folder / "street")
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as said:
            if run(self.arguments(num_workers=1)):
                raise RuntimeError(said.getvalue())
        self._expected = self.rows()
        self.out = folder / "timed"
        start_s = time.monotonic()
        self.end(self.start())
        self.duration_s = time.monotonic() - start_s
        self.out = folder / "out"

    def arguments(self, *more: str, num_workers: int = 2) -> list[str]:
        """The command line."""
        methods = ("--methods", "zero,ego,online", "--workers", str(num_workers))
        paths = (str(self.folder / "street"), "--out", str(self.out))
        return ["evaluate", *paths, *methods, "--pictures", "0", *more]

    def start(self, *more: str, num_workers: int = 2) -> BaseProcess:
        """Starts a run."""
        arguments = self.arguments(*more, num_workers=num_workers)
        process = _FORK.Process(target=self._run, args=(arguments,))
        process.start()
        return process

    def _run(self, arguments: list[str]) -> None:
        # Signals of the terminal are for the program that measures.
        os.setsid()
        with (self.folder / "said").open("wb") as stream:
            for number in (1, 2):
                os.dup2(stream.fileno(), number)
        main(arguments)

    def end(self, process: BaseProcess) -> tuple[int | None, str]:
        """Waits for its end; returns exit status and what it said."""
        process.join(_TIMEOUT_S)
        return process.exitcode, (self.folder / "said").read_text(errors="replace")

    def rows(self) -> Rows:
        """The errors of each row that is there; the last line may be cut."""
        rows = {}
        with suppress(OSError):
            for line in (self.out / "rows.jsonl").read_text().splitlines():
                with suppress(ValueError):
                    row = json.loads(line)
                    rows[row["method"], row["stamp_ns"]] = row["errors"]
        return rows

    def is_complete(self) -> bool:
        """Whether all rows are there as they must be, and what is made of them."""
        return self.rows() == self._expected and (self.out / "report.html").exists()

    def is_right(self) -> bool:
        """Whether the rows that are there are as they must be."""
        return self.rows().items() <= self._expected.items()

    def fate_of_next(self, *more: str) -> str:
        """Runs once more; empty if that brings all results."""
        status, said = self.end(self.start(*more, num_workers=1))
        is_whole = status == 0 and self.is_complete()
        return "" if is_whole else f"wrong after {more}: status {status}: {said[-200:]}"


@contextmanager
def small_evaluations() -> Iterator[Evaluations]:
    """Evaluations in a folder that is taken away."""
    with tempfile.TemporaryDirectory(prefix="reliability_") as folder:
        yield Evaluations(Path(folder))


def descendants(pid: int) -> list[int]:
    """Processes that a process has started, and those that these have."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]


def left_of(pids: Sequence[int]) -> tuple[str, float]:
    """What still runs of some processes after a while, empty if they are gone, and how long."""
    start_s = time.monotonic()
    while left := [pid for pid in pids if Path("/proc", str(pid), "exe").exists()]:
        if time.monotonic() - start_s > _LEFT_S:
            with suppress(OSError):
                return f"wrong: left after {_LEFT_S} s: {_described(left[0])}", float(_LEFT_S)
        time.sleep(0.05)
    return "", time.monotonic() - start_s


def _described(pid: int) -> str:
    """Command line, CPU time so far, and what a process waits for."""
    proc = Path("/proc", str(pid))
    command = (proc / "cmdline").read_text(errors="replace").replace("\0", " ")
    where = (proc / "wchan").read_text()
    return f"{command[-80:]}, {cpu_s(pid):.1f} s of CPU, in {where}"


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, and of its children that have ended."""
    times = Path("/proc", str(pid), "stat").read_text().rpartition(")")[2].split()[11:15]
    return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")
