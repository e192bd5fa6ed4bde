# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Promises on how commands end, for `reliability.py`: kills, signals, full folders."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence, Set
from contextlib import suppress
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from promises import Figure, Promise, Rounds, fates
from runs_that_are_ended import Evaluations, cpu_s, descendants, left_of, small_evaluations

# Not those of other libraries, which all processes share.
_SEGMENTS: Final = "/dev/shm/fast"
_MAX_END_S: Final = 1.0
_NODE_START_S: Final = 4.0
_EXIT_INTERRUPTED: Final = 130
_EXIT_RESULTS: Final = 4

Random = np.random.Generator


def killed_evaluations(rounds: Rounds) -> Iterator[Figure]:
    """SIGKILL of `mnsf evaluate --workers 2`, and by turns of a process that it has started."""
    found: dict[str, Counter[str]] = {"driver": Counter(), "worker": Counter()}
    lasts_s: dict[str, list[float]] = {"driver": [], "worker": []}
    with small_evaluations() as evaluations:
        for number, random in rounds:
            victim = ("driver", "worker")[number % 2]
            fate, last_s = _killed_evaluation(evaluations, victim == "driver", random)
            found[victim][fate] += 1
            lasts_s[victim].append(last_s)
    for victim, counts in found.items():
        yield fates(f"{victim} killed", counts)
    last_s = max(lasts_s["driver"], default=0.0)
    yield "processes of a killed driver end within", f"{last_s:.1f} s", True


def _killed_evaluation(
    evaluations: Evaluations, is_driver: bool, random: Random
) -> tuple[str, float]:
    """What became of the results, and how long a process was left after the run."""
    shutil.rmtree(evaluations.out, ignore_errors=True)
    driver = evaluations.start()
    time.sleep(random.uniform(0, evaluations.duration_s))
    family = descendants(driver.pid)
    victim = driver.pid if is_driver else int(random.choice(family)) if family else 0
    if victim:
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
    status, said = evaluations.end(driver)
    left, last_s = left_of(family)
    return left or _fate(evaluations, status, said), last_s


def _fate(evaluations: Evaluations, status: int | None, said: str) -> str:
    if "Traceback" in said:
        return f"wrong: {said[-200:]}"
    if status == 0:
        return "as without" if evaluations.is_complete() else f"wrong: other results: {said[-200:]}"
    if not evaluations.is_right():
        return "wrong: other rows"
    more = ("--resume",) if (evaluations.out / "run.json").exists() else ()
    return evaluations.fate_of_next(*more) or ("with --resume" if more else "nothing was begun")


def signals(rounds: Rounds) -> Iterator[Figure]:
    """SIGINT and SIGTERM at any moment from exec on, to the node and two commands.

    What Python does before it runs any program is seen beside them, in one that does nothing.
    """
    left: set[str] = set()
    with small_evaluations() as evaluations:
        simulated = evaluations.folder / "simulated"
        program = [sys.executable, "-m", "mnsf_ros.cli"]
        simulate = ["simulate", "--duration-s", "2", "--num-beams", "16", str(simulated)]
        commands: dict[str, tuple[list[str], tuple[int, ...]]] = {
            "python -c pass": ([sys.executable, "-c", "pass"], (0,)),
            "node": ([sys.executable, "-m", "mnsf_ros.node"], (0,)),
            "mnsf evaluate": ([*program, *evaluations.arguments()], (0, _EXIT_INTERRUPTED)),
            "mnsf simulate": ([*program, *simulate], (0, _EXIT_INTERRUPTED)),
        }
        longest_s = {name: _duration_s(command) for name, (command, _) in commands.items()}
        found: dict[str, Counter[str]] = {name: Counter() for name in commands}
        ends: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
        for number, random in rounds:
            name = list(commands)[number % len(commands)]
            for folder in (evaluations.out, simulated):
                shutil.rmtree(folder, ignore_errors=True)
            one = (signal.SIGINT, signal.SIGTERM)[number // len(commands) % 2]
            command, statuses = commands[name]
            delay_s = random.uniform(0, longest_s[name])
            end = _signalled(command, one, delay_s, statuses)
            found[name][end.fate] += 1
            ends[name].append((end.after_s, end.cpu_s))
            left |= end.left
    for name, counts in found.items():
        yield fates(f"{name} ({longest_s[name]:.1f} s)", counts)
        if ends[name]:
            (longest, cpu), median_s = max(ends[name]), np.median([end for end, _ in ends[name]])
            text = f"{longest:.2f} s at most ({cpu:.2f} s of CPU), median {median_s:.2f} s"
            yield "ends in", text, longest <= _MAX_END_S
    yield "left in /dev/shm", " ".join(sorted(left)) or "nothing", not left


class _End(NamedTuple):
    """What became of a command after a signal.

    Attributes:
        fate: In words.
        after_s: How long it took to end.
        cpu_s: CPU time that this took.
        left: Shared memory of the process that was there when it had ended.
    """

    fate: str
    after_s: float
    cpu_s: float = 0.0
    left: Set[str] = frozenset()


def _duration_s(command: Sequence[str]) -> float:
    """How long a command takes; the node does not end."""
    start_s = time.monotonic()
    with suppress(subprocess.TimeoutExpired):
        subprocess.run(command, capture_output=True, timeout=2 * _NODE_START_S, check=False)
    return time.monotonic() - start_s


def _signalled(
    command: Sequence[str], number: int, delay_s: float, statuses: Sequence[int]
) -> _End:
    """Starts a command and sends it a signal."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True
        )
        time.sleep(delay_s)
        family, shared = descendants(process.pid), _shared(process.pid)
        before_s = _ended_cpu_s() + cpu_s(process.pid)
        start_s = time.monotonic()
        process.send_signal(number)
        try:
            status = process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return _End(f"wrong: not within 10 s, {delay_s:.2f} s after the start", 10.0)
        after_s, took_s = time.monotonic() - start_s, _ended_cpu_s() - before_s
        said.seek(0)
        text = said.read().decode(errors="replace")
    fate = left_of(family)[0] or _fate_by_signal(status, number, text, status in statuses)
    # Ports are shared: what another program still uses is not left.
    left = {path for path in shared if Path(path).exists()} - _shared_by_all()
    return _End(fate, after_s, took_s, left)


def _fate_by_signal(status: int, number: int, said: str, is_expected: bool) -> str:
    if status == -number and not said:
        return "before the program began"
    if "KeyboardInterrupt" in said and "mnsf_ros/" not in said:
        return "in Python's own code"
    if not is_expected or "Traceback" in said:
        return f"wrong: status {status}: {said[-300:]}"
    return f"status {status}"


def _shared(pid: int) -> set[str]:
    """Shared memory that a process has now."""
    with suppress(OSError):
        maps = Path("/proc", str(pid), "maps").read_text().split()
        return {word for word in maps if word.startswith(_SEGMENTS)}
    return set()


def _shared_by_all() -> set[str]:
    """Shared memory that any process has now."""
    return set().union(*(_shared(int(proc.name)) for proc in Path("/proc").glob("[0-9]*")))


def _ended_cpu_s() -> float:
    """CPU time of all processes that this one has started and that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def disk(rounds: Rounds) -> Iterator[Figure]:
    """Folders of results that are full, read-only or vanish, by turns; mounts small ones."""
    kinds = {"full": _fill, "read-only": _read_only, "vanished": _vanish}
    found: dict[str, Counter[str]] = {name: Counter() for name in kinds}
    with small_evaluations() as evaluations:
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


def _fill(evaluations: Evaluations, place: Path, random: Random) -> str:
    """Leaves a few kilobytes, and then all."""
    ballast = place / "ballast"
    ballast.write_bytes(bytes(2**20 - int(random.integers(1, 60)) * 4096))
    fate = _ended(evaluations, evaluations.start())
    ballast.unlink()
    if fate != f"status {_EXIT_RESULTS}":
        return fate
    return evaluations.fate_of_next("--resume") or f"{fate}, then with --resume"


def _read_only(evaluations: Evaluations, place: Path, _random: Random) -> str:
    subprocess.run(["mount", "-o", "remount,ro", place], check=True)
    return _ended(evaluations, evaluations.start())


def _vanish(evaluations: Evaluations, _place: Path, random: Random) -> str:
    """Removes the folder while the results are written."""
    process = evaluations.start()
    time.sleep(random.uniform(0, evaluations.duration_s))
    shutil.rmtree(evaluations.out, ignore_errors=True)
    return _ended(evaluations, process)


def _ended(evaluations: Evaluations, process: BaseProcess) -> str:
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
    "runs": Promise(
        "SIGKILL of an evaluation and of its processes at any moment: results as without, or "
        "`--resume` brings them",
        *(200, "kills", killed_evaluations),
    ),
    "signals": Promise(
        "SIGINT and SIGTERM at any moment: status, silence, under a second, nothing left in "
        "/dev/shm; what Python itself does with them is counted, with a program that does nothing "
        "beside",
        *(200, "signals", signals),
    ),
}
