"""Promises on how processes end, for `reliability.py`: kills, signals, full folders."""

from __future__ import annotations

import argparse
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from online_live import Figure, live_node, serialized, with_stamp
from online_recordings import simulated_sweeps

from mnsf_ros.demo.node_process import node_process
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.node.replay_link import ReplayLink
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

_SHM: Final = Path("/dev/shm")
_MAX_END_S: Final = 1.0
_TIMEOUT_S: Final = 300
# The process that starts workers ends when it has imported what they need.
_LEFT_S: Final = 60
_METHODS: Final = "zero,ego,online"
_EXIT_INTERRUPTED: Final = 130
_EXIT_RESULTS: Final = 4

Rows = dict[tuple[str, int], Any]


def _evaluation(bag: Path, out: Path, *more: str) -> list[str]:
    command = [sys.executable, "-m", "mnsf_ros.cli", "evaluate", str(bag), "--out", str(out)]
    return [*command, "--methods", _METHODS, "--workers", "2", "--pictures", "0", *more]


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)


def _rows(out: Path) -> Rows:
    """The errors of each row of a run that are there; the last line may be cut."""
    rows = {}
    with suppress(OSError):
        for line in (out / "rows.jsonl").read_text().splitlines():
            with suppress(ValueError):
                row = json.loads(line)
                rows[row["method"], row["stamp_ns"]] = row["errors"]
    return rows


@contextmanager
def _reference(sweeps: int = 20) -> Iterator[tuple[Path, Path, Rows]]:
    """A working folder, a small recording in it, and the rows of an evaluation of it."""
    with tempfile.TemporaryDirectory(prefix="reliability_") as folder:
        bag = Path(folder, "street")
        settings = SimulationSettings(duration_s=sweeps / 10, num_beams=16, num_columns=360)
        write_recording(settings, bag)
        done = _run(_evaluation(bag, Path(folder, "reference")))
        if done.returncode:
            raise RuntimeError(done.stderr)
        yield Path(folder), bag, _rows(Path(folder, "reference"))


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


def _are_gone(pids: Sequence[int]) -> bool:
    deadline_s = time.monotonic() + _LEFT_S
    while any(Path("/proc", str(pid), "exe").exists() for pid in pids):
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.05)
    return True


def kills(options: argparse.Namespace) -> Iterator[Figure]:
    """SIGKILL of worker, driver, node and publisher at any moment."""
    random = np.random.default_rng(options.seed)
    with _reference() as (folder, bag, expected):
        for name in ("worker", "driver"):
            fates: Counter[str] = Counter()
            for _ in range(options.number):
                fates[_killed_evaluation(folder, bag, expected, name == "driver", random)] += 1
            text = ", ".join(f"{fate}: {count}" for fate, count in sorted(fates.items()))
            yield f"{name} of an evaluation", text, "wrong" not in " ".join(fates)
    yield from _killed_nodes(options.number, random)
    yield from _killed_publishers(options.number, random)


def _killed_evaluation(
    folder: Path, bag: Path, expected: Rows, is_driver: bool, random: np.random.Generator
) -> str:
    """What became of the results."""
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryFile() as said:
        driver = subprocess.Popen(_evaluation(bag, out), stdout=said, stderr=said)
        time.sleep(random.uniform(0.5, 6.0))
        family = _descendants(driver.pid)
        victim = driver.pid if is_driver else int(random.choice(family)) if family else 0
        if victim:
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
        status = driver.wait(_TIMEOUT_S)
    if not _are_gone(family):
        return "wrong: processes are left"
    if status == 0:
        return "as without" if _rows(out) == expected else "wrong: other rows"
    more = ("--resume",) if (out / "run.json").exists() else ()
    done = _run(_evaluation(bag, out, *more))
    if done.returncode or _rows(out) != expected:
        return f"wrong after --resume: {done.returncode} {done.stderr.strip()[-200:]}"
    return "with --resume" if more else "nothing was begun"


def _killed_nodes(number: int, random: np.random.Generator) -> Iterator[Figure]:
    """The node is killed and started again; the publisher goes on."""
    prepare_environment()
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    arguments = ["-r", "~/points:=/points", "-p", "node.diagnostics_period_s:=0.2"]
    came_back = 0
    with tempfile.TemporaryDirectory() as folder:
        arrived: list[int] = []
        link = ReplayLink("/points", "/scene_flow/flow", lambda f: arrived.append(f.stamp_ns), id)
        with link:
            for _ in range(number):
                with node_process(arguments, Path(folder, "log")) as process:
                    for _ in range(round(random.uniform(0, 40))):
                        link.publish(with_stamp(good, time.time_ns()))
                        link.spin_for(0.1)
                    os.kill(process.pid, signal.SIGKILL)
                arrived.clear()
                with node_process(arguments, Path(folder, "log")) as process:
                    deadline_s = time.monotonic() + _TIMEOUT_S / 5
                    while not arrived and time.monotonic() < deadline_s:
                        process.check()
                        link.publish(with_stamp(good, time.time_ns()))
                        link.spin_for(0.1)
                    came_back += bool(arrived)
    yield "node: flow after the next start", f"{came_back} of {number}", came_back == number


def _killed_publishers(number: int, random: np.random.Generator) -> Iterator[Figure]:
    """Publishers in processes of their own are killed, one after the other; the node goes on."""
    answered = 0
    context = multiprocessing.get_context("spawn")
    with live_node("node.diagnostics_period_s:=0.2", "node.always_estimate:=true") as node:
        for _ in range(number):
            publisher = context.Process(target=_publish_for_ever, daemon=True)
            publisher.start()
            before = node.link.counts.get("flows_out", 0)
            deadline_s = time.monotonic() + _TIMEOUT_S / 5
            is_answered = False
            while not is_answered and time.monotonic() < deadline_s:
                node.process.check()
                node.link.spin_for(0.1)
                is_answered = node.link.counts.get("flows_out", 0) > before
            answered += is_answered
            time.sleep(random.uniform(0, 0.3))
            publisher.kill()
            publisher.join()
        tracebacks = node.log.read_text(errors="replace").count("Traceback")
    is_met = answered == number and tracebacks == 0
    yield "publisher: flow for the next one", f"{answered} of {number}", is_met


def _publish_for_ever() -> None:
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    with ReplayLink("/points", "/elsewhere", id, id) as link:
        while True:
            link.publish(with_stamp(good, time.time_ns()))
            link.spin_for(0.1)


def signals(options: argparse.Namespace) -> Iterator[Figure]:
    """SIGINT and SIGTERM at any moment: status, silence, under a second, nothing left."""
    random = np.random.default_rng(options.seed)
    shared = set(_SHM.iterdir())
    with _reference() as (folder, bag, _):
        commands: Mapping[str, tuple[list[str], float, tuple[int, ...]]] = {
            "node": ([sys.executable, "-m", "mnsf_ros.node"], 5.0, (0,)),
            "mnsf evaluate": (_evaluation(bag, folder / "out"), 6.0, (0, _EXIT_INTERRUPTED)),
            "mnsf simulate": (
                [sys.executable, "-m", "mnsf_ros.cli", "simulate", str(folder / "simulated")],
                4.0,
                (0, _EXIT_INTERRUPTED),
            ),
        }
        for name, (command, longest_s, statuses) in commands.items():
            fates: Counter[str] = Counter()
            ends_s = []
            for index in range(options.number // len(commands)):
                for left in ("out", "simulated"):
                    shutil.rmtree(folder / left, ignore_errors=True)
                number = (signal.SIGINT, signal.SIGTERM)[index % 2]
                delay_s = random.uniform(0, longest_s)
                fate, end_s = _signalled(command, number, delay_s, statuses)
                fates[fate] += 1
                ends_s.append(end_s)
            text = ", ".join(f"{fate}: {count}" for fate, count in sorted(fates.items()))
            yield name, text, "wrong" not in " ".join(fates)
            slowest = f"{max(ends_s):.2f} s, median {np.median(ends_s):.2f} s"
            yield f"{name}, slowest end", slowest, max(ends_s) <= _MAX_END_S
    left = len(set(_SHM.iterdir()) - shared)
    yield "left in /dev/shm", str(left), left == 0


def _signalled(
    command: Sequence[str], number: int, delay_s: float, statuses: Sequence[int]
) -> tuple[str, float]:
    """What became of a command, and how long it took to end."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
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
    if not _are_gone(family):
        return "wrong: processes are left", end_s
    if "Traceback" in text:
        return f"wrong: traceback, {delay_s:.2f} s after the start", end_s
    if status == -number:
        return "before the program began", end_s
    if status not in statuses:
        return f"wrong: status {status}, {delay_s:.2f} s after the start: {text[-200:]}", end_s
    return f"status {status}", end_s


def disk(options: argparse.Namespace) -> Iterator[Figure]:
    """Full disk, read-only and vanished folders; needs root, to mount small file systems."""
    random = np.random.default_rng(options.seed)
    with _reference() as (folder, bag, expected):
        for name, prepare in (("full", _fill), ("read-only", _read_only), ("vanished", _vanish)):
            fates: Counter[str] = Counter()
            for _ in range(options.number):
                fates[_on_small_disk(folder, bag, expected, prepare, random)] += 1
            text = ", ".join(f"{fate}: {count}" for fate, count in sorted(fates.items()))
            yield f"{name} folder of results", text, "wrong" not in " ".join(fates)


def _on_small_disk(
    folder: Path,
    bag: Path,
    expected: Rows,
    prepare: Callable[[Path, np.random.Generator], Callable[[], None]],
    random: np.random.Generator,
) -> str:
    """What became of an evaluation onto a file system that is made small or goes away."""
    disk_folder = folder / "disk"
    disk_folder.mkdir(exist_ok=True)
    out = disk_folder / "out"
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", disk_folder], check=True)
    try:
        restore = prepare(disk_folder, random)
        process = subprocess.Popen(
            _evaluation(bag, out), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        if prepare is _vanish:
            time.sleep(random.uniform(0.5, 5))
            shutil.rmtree(out, ignore_errors=True)
        _, text = process.communicate(timeout=_TIMEOUT_S)
        status, rows = process.returncode, _rows(out)
        if "Traceback" in text or status not in (0, 2, 3, _EXIT_RESULTS):
            return f"wrong: status {status}: {text[-300:]}"
        if any(expected.get(key) != row for key, row in rows.items()):
            return "wrong: other rows"
        if status == 0 and rows != expected:
            return "wrong: status 0 without results"
        restore()
        if status == _EXIT_RESULTS and prepare is _fill:
            done = _run(_evaluation(bag, out, "--resume"))
            if done.returncode or _rows(out) != expected:
                return f"wrong after --resume: {done.returncode} {done.stderr[-200:]}"
            return "status 4, then with --resume"
        return f"status {status}"
    finally:
        subprocess.run(["umount", disk_folder], check=True)


def _fill(disk_folder: Path, random: np.random.Generator) -> Callable[[], None]:
    """Leaves a few kilobytes."""
    ballast = disk_folder / "ballast"
    left = int(random.integers(1, 60)) * 4096
    ballast.write_bytes(bytes(2**20 - left))
    return ballast.unlink


def _read_only(disk_folder: Path, _random: np.random.Generator) -> Callable[[], None]:
    subprocess.run(["mount", "-o", "remount,ro", disk_folder], check=True)
    return lambda: None


def _vanish(_disk_folder: Path, _random: np.random.Generator) -> Callable[[], None]:
    return lambda: None


PROMISES: Final = {"kills": kills, "signals": signals, "disk": disk}
