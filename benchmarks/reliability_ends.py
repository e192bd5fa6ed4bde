"""Promises on how processes end, for `reliability.py`: kills, signals, full folders."""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

import numpy as np
from online_live import live_node, serialized, with_stamp
from online_recordings import simulated_sweeps
from promises import Figure, Promise, Rounds, fates

from mnsf_ros.cli.main import main, run
from mnsf_ros.demo.node_process import node_process
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.node.replay_link import ReplayLink
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

_SHM: Final = Path("/dev/shm")
_MAX_END_S: Final = 1.0
_TIMEOUT_S: Final = 300
_FLOW_TIMEOUT_S: Final = 60
# The process that starts workers ends when it has imported what they need.
_LEFT_S: Final = 120
_NODE_START_S: Final = 4.0
_EXIT_INTERRUPTED: Final = 130
_EXIT_RESULTS: Final = 4
_OLD_S: Final = 61
# Two segments.
_MAX_SHARED_MB: Final = 53
_FORK: Final = multiprocessing.get_context("fork")

Rows = dict[tuple[str, int], Any]
Random = np.random.Generator


class _Evaluations:
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
def _evaluations() -> Iterator[_Evaluations]:
    with tempfile.TemporaryDirectory(prefix="reliability_") as folder:
        yield _Evaluations(Path(folder))


def _descendants(pid: int) -> list[int]:
    """Processes that a process has started, and those that these have."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]


def _left(pids: Sequence[int]) -> str:
    """What still runs of some processes after a while; empty if they are gone."""
    deadline_s = time.monotonic() + _LEFT_S
    while left := [pid for pid in pids if Path("/proc", str(pid), "exe").exists()]:
        if time.monotonic() > deadline_s:
            command = Path("/proc", str(left[0]), "cmdline").read_text(errors="replace")
            return f"wrong: left after {_LEFT_S} s: {command[-80:]}"
        time.sleep(0.05)
    return ""


def killed_evaluations(rounds: Rounds) -> Iterator[Figure]:
    """SIGKILL of `mnsf evaluate --workers 2`, and by turns of a process that it has started."""
    found: dict[str, Counter[str]] = {"driver": Counter(), "worker": Counter()}
    with _evaluations() as evaluations:
        for number, random in rounds:
            victim = ("driver", "worker")[number % 2]
            found[victim][_killed_evaluation(evaluations, victim == "driver", random)] += 1
    for victim, counts in found.items():
        yield fates(f"{victim} killed", counts)


def _killed_evaluation(evaluations: _Evaluations, is_driver: bool, random: Random) -> str:
    """What became of the results."""
    shutil.rmtree(evaluations.out, ignore_errors=True)
    driver = evaluations.start()
    time.sleep(random.uniform(0, evaluations.duration_s))
    family = _descendants(driver.pid)
    victim = driver.pid if is_driver else int(random.choice(family)) if family else 0
    if victim:
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
    status, said = evaluations.end(driver)
    if left := _left(family):
        return left
    if "Traceback" in said:
        return f"wrong: {said[-200:]}"
    if status == 0:
        return "as without" if evaluations.is_complete() else f"wrong: other results: {said[-200:]}"
    if not evaluations.is_right():
        return "wrong: other rows"
    more = ("--resume",) if (evaluations.out / "run.json").exists() else ()
    return evaluations.fate_of_next(*more) or ("with --resume" if more else "nothing was begun")


def killed_nodes(rounds: Rounds) -> Iterator[Figure]:
    """SIGKILL of the node, by turns while it starts and after it has answered."""
    prepare_environment()
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    arguments = ["-r", "~/points:=/points"]
    found: Counter[str] = Counter()
    before = _shared_mb()
    arrived: list[int] = []
    link = ReplayLink("/points", "/scene_flow/flow", lambda f: arrived.append(f.stamp_ns), id)
    with tempfile.TemporaryDirectory() as folder, link:
        log = Path(folder, "log")
        for number, random in rounds:
            with node_process(arguments, log) as process:
                end_s = time.monotonic() + random.uniform(0, _NODE_START_S)
                if number % 2 == 0:
                    arrived.clear()
                    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
                    while not arrived and time.monotonic() < deadline_s:
                        process.check()
                        link.publish(with_stamp(good, time.time_ns()))
                        link.spin_for(0.1)
                    found["flow after the next start" if arrived else "wrong: no flow"] += 1
                    end_s = time.monotonic() + random.uniform(0, 1)
                while time.monotonic() < end_s:
                    link.publish(with_stamp(good, time.time_ns()))
                    link.spin_for(min(0.1, end_s - time.monotonic()))
                found["killed while it starts"] += number % 2
                os.kill(process.pid, signal.SIGKILL)
        # A node that starts removes what is older than a minute.
        time.sleep(_OLD_S)
        with node_process(arguments, log):
            link.spin_for(_NODE_START_S)
    yield fates("node killed", found)
    growth_mb = _shared_mb() - before
    yield "left in /dev/shm", f"{growth_mb:.0f} MB", growth_mb < _MAX_SHARED_MB


def _shared_mb() -> float:
    return sum(file.stat().st_blocks * 512 for file in _SHM.iterdir()) / 1e6


def killed_publishers(rounds: Rounds) -> Iterator[Figure]:
    """Publishers in processes of their own are killed, one after the other; the node goes on."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([ReplayLink.__module__, with_stamp.__module__])
    found: Counter[str] = Counter()
    with live_node("node.diagnostics_period_s:=0.2", "node.always_estimate:=true") as node:
        for _, random in rounds:
            publisher = context.Process(target=_publish_for_ever, args=(good,), daemon=True)
            publisher.start()
            before = node.link.counts.get("flows_out", 0)
            deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
            is_answered = False
            while not is_answered and time.monotonic() < deadline_s:
                node.process.check()
                node.link.spin_for(0.1)
                is_answered = node.link.counts.get("flows_out", 0) > before
            found["flow for the next one" if is_answered else "wrong: no flow"] += 1
            time.sleep(random.uniform(0, 0.3))
            publisher.kill()
            publisher.join()
        tracebacks = node.log.read_text(errors="replace").count("Traceback")
    yield fates("publisher killed", found)
    yield "tracebacks in the log", str(tracebacks), tracebacks == 0


def _publish_for_ever(good: bytearray) -> None:
    with ReplayLink("/points", "/elsewhere", id, id) as link:
        while True:
            link.publish(with_stamp(good, time.time_ns()))
            link.spin_for(0.1)


def signals(rounds: Rounds) -> Iterator[Figure]:
    """SIGINT and SIGTERM at any moment from exec on, to the node and two commands."""
    shared = set(_SHM.iterdir())
    with _evaluations() as evaluations:
        simulated = evaluations.folder / "simulated"
        program = [sys.executable, "-m", "mnsf_ros.cli"]
        simulate = ["simulate", "--duration-s", "2", "--num-beams", "16", str(simulated)]
        commands: dict[str, tuple[list[str], tuple[int, ...]]] = {
            "node": ([sys.executable, "-m", "mnsf_ros.node"], (0,)),
            "mnsf evaluate": ([*program, *evaluations.arguments()], (0, _EXIT_INTERRUPTED)),
            "mnsf simulate": ([*program, *simulate], (0, _EXIT_INTERRUPTED)),
        }
        longest_s = {name: _duration_s(command) for name, (command, _) in commands.items()}
        found: dict[str, Counter[str]] = {name: Counter() for name in commands}
        ends_s: dict[str, list[float]] = {name: [] for name in commands}
        for number, random in rounds:
            name = list(commands)[number % len(commands)]
            for left in (evaluations.out, simulated):
                shutil.rmtree(left, ignore_errors=True)
            one = (signal.SIGINT, signal.SIGTERM)[number // len(commands) % 2]
            command, statuses = commands[name]
            delay_s = random.uniform(0, longest_s[name])
            fate, end_s = _signalled(command, one, delay_s, statuses)
            found[name][fate] += 1
            ends_s[name].append(end_s)
    for name, counts in found.items():
        yield fates(name, counts)
        text = f"{max(ends_s[name]):.2f} s at most, median {np.median(ends_s[name]):.2f} s"
        yield f"{name} ends in", text, max(ends_s[name]) <= _MAX_END_S
    left = len(set(_SHM.iterdir()) - shared)
    yield "left in /dev/shm", str(left), left == 0


def _duration_s(command: Sequence[str]) -> float:
    """How long a command takes; the node does not end."""
    start_s = time.monotonic()
    with suppress(subprocess.TimeoutExpired):
        subprocess.run(command, capture_output=True, timeout=2 * _NODE_START_S, check=False)
    return time.monotonic() - start_s


def _signalled(
    command: Sequence[str], number: int, delay_s: float, statuses: Sequence[int]
) -> tuple[str, float]:
    """What became of a command, and how long it took to end."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True
        )
        time.sleep(delay_s)
        family = _descendants(process.pid)
        start_s = time.monotonic()
        process.send_signal(number)
        try:
            status = process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return f"wrong: not within 10 s, {delay_s:.2f} s after the start", 10.0
        end_s = time.monotonic() - start_s
        said.seek(0)
        text = said.read().decode(errors="replace")
    if left := _left(family):
        return left, end_s
    if status == -number and "mnsf_ros" not in text:
        return "wrong: Python's start" if text else "before the program began", end_s
    if status not in statuses or "Traceback" in text:
        return f"wrong: status {status}, {delay_s:.2f} s after the start: {text[-200:]}", end_s
    return f"status {status}", end_s


def disk(rounds: Rounds) -> Iterator[Figure]:
    """Folders of results that are full, read-only or vanish, by turns; mounts small ones."""
    kinds = {"full": _fill, "read-only": _read_only, "vanished": _vanish}
    found: dict[str, Counter[str]] = {name: Counter() for name in kinds}
    with _evaluations() as evaluations:
        place = evaluations.folder / "disk"
        evaluations.out = place / "out"
        place.mkdir()
        for number, random in rounds:
            name = list(kinds)[number % len(kinds)]
            subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", place], check=True)
            try:
                found[name][kinds[name](evaluations, place, random)] += 1
            finally:
                subprocess.run(["umount", place], check=True)
    for name, counts in found.items():
        yield fates(f"{name} folder of results", counts)


def _fill(evaluations: _Evaluations, place: Path, random: Random) -> str:
    """Leaves a few kilobytes, and then all."""
    ballast = place / "ballast"
    ballast.write_bytes(bytes(2**20 - int(random.integers(1, 60)) * 4096))
    fate = _ended(evaluations, evaluations.start())
    ballast.unlink()
    if fate != f"status {_EXIT_RESULTS}":
        return fate
    return evaluations.fate_of_next("--resume") or f"{fate}, then with --resume"


def _read_only(evaluations: _Evaluations, place: Path, _random: Random) -> str:
    subprocess.run(["mount", "-o", "remount,ro", place], check=True)
    return _ended(evaluations, evaluations.start())


def _vanish(evaluations: _Evaluations, _place: Path, random: Random) -> str:
    """Removes the folder while the results are written."""
    process = evaluations.start()
    time.sleep(random.uniform(0, evaluations.duration_s))
    shutil.rmtree(evaluations.out, ignore_errors=True)
    return _ended(evaluations, process)


def _ended(evaluations: _Evaluations, process: BaseProcess) -> str:
    status, said = evaluations.end(process)
    if "Traceback" in said or status not in (0, 2, 3, _EXIT_RESULTS):
        return f"wrong: status {status}: {said[-300:]}"
    if not evaluations.is_right():
        return "wrong: other rows"
    return f"status {status}"


PROMISES: Final = {
    "disk": Promise(
        "full disk, read-only and vanished folders: one line, the documented status, nothing lost "
        "that was done (as root: it mounts small disks)",
        *(60, "evaluations", disk),
    ),
    "publishers": Promise(
        "SIGKILL of publishers: the node goes on", *(100, "kills", killed_publishers)
    ),
    "nodes": Promise(
        "SIGKILL of the node at any moment: flow after the next start",
        *(200, "kills", killed_nodes),
    ),
    "runs": Promise(
        "SIGKILL of an evaluation and of its processes at any moment: results as without, or "
        "`--resume` brings them",
        *(200, "kills", killed_evaluations),
    ),
    "signals": Promise(
        "SIGINT and SIGTERM at any moment: status, silence, under a second, nothing left in "
        "/dev/shm",
        *(200, "signals", signals),
    ),
}
