# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Measures the promises of docs/reliability.md: `python benchmarks/reliability.py PROMISE`.

Each is tried in rounds, which have numbers and randomness of their own: `--first 100` goes on
where a shorter run ended. Ctrl-C ends a promise after its round. Prints the figures and a row for
the document. Use a ROS_DOMAIN_ID of its own.
"""

from __future__ import annotations

import itertools
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mutated_bags
import numpy as np
import pandas as pd
from drives import INTERVAL_NS, simulated_sweeps, to_and_fro
from frame import Table, make_parser, show, this_machine
from live_node import FIRST_NS, LiveNode, busy_cores, live_node, serialized, with_stamp

from mnsf_ros.cli.memory import limited_memory
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

Random = np.random.Generator
# Name of a figure, its text, and whether it keeps the promise.
Figure = tuple[str, str, bool]
_OFTEN: Final = "node.diagnostics_period_s:=0.2"
_FLOW_TIMEOUT_S: Final = 300
_NODE_START_S: Final = 4.0
_LOOK_S: Final = 10
_WARM_UP_MIN: Final = 10
_MAX_GROWTH_MB: Final = 20
# With fewer dropped sweeps the machine was not overloaded.
_MIN_DROPPED: Final = 0.1
_MAX_LOG_BYTES: Final = 10
# A few lines are allowed in a short run.
_FEW_CLOUDS: Final = 1000
# The fields of a serialized cloud are in its first bytes.
_HEAD_BYTES: Final = 200
_MAX_END_S: Final = 1.0
_END_TIMEOUT_S: Final = 120
_INTERRUPTED: Final = 130
_COLUMNS: Final = ("recording", "method", "points", "num_examples", "epe_m", "acc5", "recall")
_MNSF: Final = (sys.executable, "-m", "mnsf_ros.cli")


class Rounds:
    """Numbers of rounds, each with its own randomness; they end early when the time is over.

    Attributes:
        done: Number of rounds that have ended.
        seed: Seed of the randomness.
    """

    def __init__(self, number: int, minutes: float, first: int = 0, seed: int = 0) -> None:
        self.done = 0
        self._numbers = range(first, first + number)
        self._end_s = time.monotonic() + minutes * 60
        self.seed = seed

    def __iter__(self) -> Iterator[tuple[int, Random]]:
        """Yields the number of each round and its random numbers."""
        for number in self._numbers:
            if time.monotonic() > self._end_s:
                return
            yield number, np.random.default_rng([self.seed, number])
            self.done += 1

    def stop(self) -> None:
        """Makes the current round the last one."""
        self._end_s = 0.0


@dataclass(frozen=True)
class Promise:
    """A promise that holds in every round.

    Attributes:
        number: Rounds after which it counts as measured.
        unit: Name of the rounds.
        measure: Tries it and yields figures; its docstring is the promise.
    """

    number: int
    unit: str
    measure: Callable[[Rounds], Iterator[Figure]]

    @property
    def text(self) -> str:
        """The promise in one line."""
        return " ".join((self.measure.__doc__ or "").split()).rstrip(".")


def main() -> None:
    """Measures a promise and ends with status 1 if it does not hold."""
    parser = make_parser(__doc__, has_document=False)
    parser.add_argument("promise", choices=PROMISES)
    parser.add_argument("--number", type=int, help="rounds (default: the number of the promise)")
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after this time")
    options = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    promise = PROMISES[options.promise]
    number = options.number or promise.number - options.first
    rounds = Rounds(number, options.minutes, options.first, options.seed)
    signal.signal(signal.SIGINT, lambda *_: rounds.stop())
    figures = list(promise.measure(rounds))
    rows = [[name, text, "" if is_met else "MISSED"] for name, text, is_met in figures]
    result = verdict(promise, rounds, figures)
    done = f"{rounds.done:,} of {promise.number:,} {promise.unit}"
    show(Table(f"{this_machine()}: {promise.text}", ["", "measured", ""], rows).markdown())
    print(f"| `{options.promise}` | {promise.text} | {done} | {result} |")
    raise SystemExit(result == "MISSED")


def verdict(promise: Promise, rounds: Rounds, figures: Sequence[Figure]) -> str:
    """`met`, `MISSED`, or `in part` after too few rounds."""
    if not all(is_met for _, _, is_met in figures):
        return "MISSED"
    return "met" if rounds.done >= promise.number else "in part"


def fates(name: str, found: Counter[str], wrong: Sequence[str] = ()) -> Figure:
    """The counted fates of all rounds; those that begin with "wrong" break the promise."""
    text = ", ".join(f"{fate}: {count:,}" for fate, count in sorted(found.items()))
    return name, text, not any(fate.startswith(("wrong", *wrong)) for fate in found)


def growth(states: Sequence[Mapping[str, float]]) -> Iterator[Figure]:
    """Compares the most memory, descriptors, threads and segments of the first and the last states.

    Memory goes up and down with the work of the threads, so two spans are compared.
    """
    # Of a short run, the first and the last third.
    span = max(1, min(60 * _WARM_UP_MIN // _LOOK_S, len(states) // 3))
    early, late = (
        {name: max(state[name] for state in part) for name in states[0]}
        for part in (states[:span], states[-span:])
    )
    is_met = late["MB"] - early["MB"] <= _MAX_GROWTH_MB
    yield "memory", f"{early['MB']:.0f} -> {late['MB']:.0f} MB", is_met
    for name in ("descriptors", "threads", "segments"):
        yield name, f"{early[name]:.0f} -> {late[name]:.0f}", late[name] <= early[name]


def _clouds(**settings: int) -> Iterator[bytearray]:
    """Serialized sweeps of a simulated street at walking speed, to and fro without end."""
    drive = simulated_sweeps(0, 24, ego_speed_m_s=2, **settings)
    return itertools.cycle(to_and_fro(serialized(item.sweep) for item in drive))


def _played(node: LiveNode, rounds: Rounds, rate_hz: int) -> Iterator[Figure]:
    """Publishes a full sweep each round, then yields growth and balance."""
    clouds, states = _clouds(), [node.state()]
    start_s = due_s = time.monotonic()
    for _ in rounds:
        node.link.spin_for(due_s - time.monotonic())
        node.process.check()
        node.publish(next(clouds), 10**9 // rate_hz)
        if time.monotonic() - start_s > _LOOK_S * len(states):
            states.append(node.state())
        # A lidar does not make up for lost time.
        due_s = max(due_s + 1 / rate_hz, time.monotonic())
    node.settle()
    yield from growth([*states[1:], node.state()])
    yield from node.balance()


def soak(rounds: Rounds) -> Iterator[Figure]:
    """24 h at 10 Hz: 20 MB more at most, no thread or descriptor more, all is counted."""
    with live_node(_OFTEN) as node:
        yield from _played(node, rounds, 10)
        yield "flows", f"{len(node.replay.arrived_s):,}", bool(node.replay.arrived_s)


def overload(rounds: Rounds) -> Iterator[Figure]:
    """1 h at 20 Hz beside busy cores: latency of two estimates at most, all is counted."""
    with live_node(_OFTEN) as node, busy_cores(os.cpu_count() or 1):
        yield from _played(node, rounds, 20)
        flows, sweeps = node.link.counts.get("flows_out", 0), node.num_published
        is_met = 0 < flows < (1 - _MIN_DROPPED) * sweeps
        yield "flows", f"{flows:,} of {sweeps:,} sweeps", is_met
        values = node.link.flow_values
        latency_ms, estimate_ms = (
            float(values.get(f"{name} median [ms]", math.nan)) for name in ("latency", "estimate")
        )
        text = f"{latency_ms:.0f} ms, an estimate takes {estimate_ms:.0f} ms"
        yield "median latency in the node", text, latency_ms <= 2 * estimate_ms


def damaged_clouds(rounds: Rounds) -> Iterator[Figure]:
    """Damaged clouds between good sweeps: flow for the good ones, all is counted."""
    good = _small_cloud()
    asked = answered = 0
    with live_node(_OFTEN, "node.always_estimate:=true") as node:
        log_bytes = node.log.stat().st_size
        for number, random in rounds:
            node.process.check()
            between = with_stamp(good, FIRST_NS + node.num_good * INTERVAL_NS - INTERVAL_NS // 2)
            size = _HEAD_BYTES if random.random() < 0.5 else len(between)
            damaged, _ = mutated_bags.mutated(between[:size], random)
            node.link.points.publish(damaged + between[size:])
            node.num_published += 1
            node.publish(good)
            node.link.spin_for(0.02)
            if number % 100 == 0:
                asked += 1
                answered += _is_answered(node, good)
        node.settle()
        log_bytes = (node.log.stat().st_size - log_bytes) // max(_FEW_CLOUDS, rounds.done)
        yield "good sweeps answered", f"{answered:,} of {asked:,}", answered == asked
        yield "log", f"{log_bytes} bytes a cloud", log_bytes <= _MAX_LOG_BYTES
        yield from node.balance()


def _small_cloud() -> bytearray:
    return serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)


def _is_answered(node: LiveNode, good: bytearray) -> bool:
    """Whether flow arrives for one of some good sweeps in a row."""
    before = len(node.replay.arrived_s)
    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
    while len(node.replay.arrived_s) == before and time.monotonic() < deadline_s:
        node.process.check()
        node.publish(good)
        node.link.spin_for(0.1)
    return len(node.replay.arrived_s) > before


def killed_nodes(rounds: Rounds) -> Iterator[Figure]:
    """SIGKILL of the node: flow after the next start."""
    good = _small_cloud()
    found: Counter[str] = Counter()
    for number, random in rounds:
        with ExitStack() as stack:
            node = stack.enter_context(live_node("node.always_estimate:=true"))
            if number % 2 == 0:
                is_answered = _is_answered(node, good)
                found["flow after the next start" if is_answered else "wrong: no flow"] += 1
            node.link.spin_for(random.uniform(0, 1))
            os.kill(node.process.pid, signal.SIGKILL)
    yield fates("node killed", found)


class _Evaluations:
    """Runs of `mnsf evaluate` on a small recording.

    Attributes:
        folder: Folder of all files.
        out: Folder of results.
        duration_s: Duration of a whole run.
    """

    def __init__(self, folder: Path) -> None:
        """Writes the recording and evaluates it."""
        self.folder, self.out = folder, folder / "out"
        settings = SimulationSettings(duration_s=1.2, num_beams=16, num_columns=180)
        write_recording(settings, folder / "street")
        end = _ended(self.command())
        if end.status:
            raise RuntimeError(end.said)
        self.duration_s = end.after_s
        self._expected = self._figures()

    def command(self, *more: str) -> list[str]:
        """Returns the command line."""
        paths = (str(self.folder / "street"), "--out", str(self.out))
        methods = ("--methods", "zero,ego,online", "--workers", "2", "--pictures", "0")
        return [*_MNSF, "evaluate", *paths, *methods, *more]

    def is_complete(self) -> bool:
        """Whether all results are there and right."""
        return self._figures() == self._expected

    def _figures(self) -> str:
        """The errors of results.csv; empty without results."""
        file = self.out / "results.csv"
        return pd.read_csv(file)[list(_COLUMNS)].to_csv() if file.exists() else ""


@contextmanager
def _evaluations() -> Iterator[_Evaluations]:
    with tempfile.TemporaryDirectory(prefix="reliability_") as folder:
        yield _Evaluations(Path(folder))


@dataclass(frozen=True)
class _End:
    """End of a command.

    Attributes:
        status: Exit status.
        said: Its output.
        after_s: Seconds to its end after `act`.
        left: A process that does not end; empty if all do.
    """

    status: int
    said: str
    after_s: float
    left: str


def _ended(
    command: Sequence[str],
    delay_s: float = 0.0,
    act: Callable[[int, list[int]], None] = lambda pid, family: None,
) -> _End:
    """Runs a command; after a while `act` gets its process id and those of its children."""
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True)
        time.sleep(delay_s)
        family, start_s = _descendants(process.pid), time.monotonic()
        act(process.pid, family)
        left = _left([process.pid])
        after_s = time.monotonic() - start_s
        process.kill()
        status = process.wait()
        output.seek(0)
        said = output.read().decode(errors="replace")
    return _End(status, said, after_s, left or _left(family))


def _descendants(pid: int) -> list[int]:
    """Child processes of a process, and theirs."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]


def _left(pids: Sequence[int]) -> str:
    deadline_s = time.monotonic() + _END_TIMEOUT_S
    while left := [pid for pid in pids if Path("/proc", str(pid), "exe").exists()]:
        if time.monotonic() > deadline_s:
            return f"wrong: process {left[0]} is left"
        time.sleep(0.05)
    return ""


def killed_runs(rounds: Rounds) -> Iterator[Figure]:
    """SIGKILL of `mnsf evaluate` or one of its processes: `--resume` brings what is missing."""
    found: dict[str, Counter[str]] = {"command": Counter(), "process": Counter()}
    with _evaluations() as evaluations:
        for number, random in rounds:
            shutil.rmtree(evaluations.out, ignore_errors=True)
            victim = list(found)[number % 2]

            def kill(
                pid: int, family: list[int], victim: str = victim, random: Random = random
            ) -> None:
                with suppress(ProcessLookupError):
                    is_command = victim == "command" or not family
                    os.kill(pid if is_command else int(random.choice(family)), signal.SIGKILL)

            delay_s = random.uniform(0, evaluations.duration_s)
            end = _ended(evaluations.command(), delay_s, kill)
            found[victim][_fate_of_killed(evaluations, end)] += 1
    for victim, counts in found.items():
        yield fates(f"{victim} killed", counts)


def _fate_of_killed(evaluations: _Evaluations, end: _End) -> str:
    if end.left or "Traceback" in end.said:
        return end.left or f"wrong: {end.said[-200:]}"
    if end.status == 0:
        return "as without" if evaluations.is_complete() else "wrong: other results"
    more = ["--resume"] if (evaluations.out / "run.json").exists() else []
    end = _ended(evaluations.command(*more))
    if end.status or not evaluations.is_complete():
        return f"wrong after {more}: status {end.status}: {end.said[-200:]}"
    return "with --resume" if more else "nothing was begun"


def signals(rounds: Rounds) -> Iterator[Figure]:
    """SIGINT and SIGTERM at any moment: documented status, no traceback, an end within 1 s."""
    with _evaluations() as evaluations:
        simulated = str(evaluations.folder / "simulated")
        # The first one shows the part of Python itself.
        commands = {
            "python -c pass": ([sys.executable, "-c", "pass"], 0.1),
            "node": ([sys.executable, "-m", "mnsf_ros.node"], _NODE_START_S),
            "mnsf evaluate": (evaluations.command(), evaluations.duration_s),
            "mnsf simulate": ([*_MNSF, "simulate", simulated], _NODE_START_S),
        }
        found: dict[str, Counter[str]] = {name: Counter() for name in commands}
        ends_s: dict[str, list[float]] = {name: [0.0] for name in commands}
        for number, random in rounds:
            name, (command, longest_s) = list(commands.items())[number % len(commands)]
            for folder in (evaluations.out, simulated):
                shutil.rmtree(folder, ignore_errors=True)
            one = (signal.SIGINT, signal.SIGTERM)[number // len(commands) % 2]
            delay_s = random.uniform(0, longest_s)
            end = _ended(command, delay_s, lambda pid, _, one=one: os.kill(pid, one))
            found[name][_fate_of_signalled(end, one)] += 1
            ends_s[name].append(end.after_s)
    for name, counts in found.items():
        yield fates(name, counts)
        yield f"{name} ends in", f"{max(ends_s[name]):.2f} s", max(ends_s[name]) <= _MAX_END_S


def _fate_of_signalled(end: _End, number: int) -> str:
    if end.left:
        return end.left
    if end.status == -number and not end.said:
        return "before the program began"
    if "KeyboardInterrupt" in end.said and "mnsf_ros/" not in end.said:
        return "in Python's own code"
    if end.status not in (0, _INTERRUPTED) or "Traceback" in end.said:
        return f"wrong: status {end.status}: {end.said[-300:]}"
    return f"status {end.status}"


def recordings(rounds: Rounds) -> Iterator[Figure]:
    """Damaged recordings of nine formats: no traceback, 60 s and 2 GB at most, no silent change."""
    folder = Path(tempfile.mkdtemp(prefix="mutated_bags_"))
    with limited_memory(mutated_bags.MAX_GB):
        found, bad = mutated_bags.run((number for number, _ in rounds), rounds.seed, folder)
    for name, counts in found.items():
        yield fates(name, counts, mutated_bags.BAD)
    for text in bad:
        yield "bad", text, False


PROMISES: Final = {
    "runs": Promise(200, "kills", killed_runs),
    "signals": Promise(200, "signals", signals),
    "recordings": Promise(10_000, "recordings", recordings),
    "nodes": Promise(200, "kills", killed_nodes),
    "clouds": Promise(10_000, "clouds", damaged_clouds),
    "overload": Promise(72_000, "sweeps", overload),
    "soak": Promise(864_000, "sweeps", soak),
}


if __name__ == "__main__":
    main()
