# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Measures the promises of docs/reliability.md: `python benchmarks/reliability.py PROMISE`.

Each is tried in rounds, which have numbers and randomness of their own: `--first 100` goes on
where a shorter run ended. Ctrl-C ends a promise after its round. Prints the figures and a row for
the document. Use a ROS_DOMAIN_ID of its own.
"""

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
from contextlib import ExitStack, suppress
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
_COLUMNS: Final = ("recording", "method", "points", "num_examples", "epe_m", "acc5", "recall")
_MNSF: Final = (sys.executable, "-m", "mnsf_ros.cli")


class Rounds:
    """Numbers of rounds, each with its own randomness.

    Attributes:
        done: Number of rounds that have ended.
        is_last: Whether the current round is the last one.
    """

    def __init__(self, number: int, first: int = 0) -> None:
        self.done, self.is_last = 0, False
        self._numbers = range(first, first + number)

    def __iter__(self) -> Iterator[tuple[int, Random]]:
        """Yields the number of each round and its random numbers."""
        for number in self._numbers:
            if self.is_last:
                return
            yield number, np.random.default_rng(number)
            self.done += 1


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
    options = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    promise = PROMISES[options.promise]
    rounds = Rounds(options.number or promise.number - options.first, options.first)
    signal.signal(signal.SIGINT, lambda *_: setattr(rounds, "is_last", True))
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
    early, late = (pd.DataFrame(part).max() for part in (states[:span], states[-span:]))
    is_met = late["MB"] - early["MB"] <= _MAX_GROWTH_MB
    yield "memory", f"{early['MB']:.0f} -> {late['MB']:.0f} MB", is_met
    for name in ("descriptors", "threads", "segments"):
        yield name, f"{early[name]:.0f} -> {late[name]:.0f}", late[name] <= early[name]


def _played(node: LiveNode, rounds: Rounds, rate_hz: int) -> Iterator[Figure]:
    """Publishes a full sweep of a street each round, then yields growth and balance."""
    drive = simulated_sweeps(0, 24, ego_speed_m_s=2)
    clouds = itertools.cycle(to_and_fro(serialized(item.sweep) for item in drive))
    states = [node.state()]
    start_s = due_s = time.monotonic()
    for _ in rounds:
        node.spin_for(due_s - time.monotonic())
        node.check()
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
        yield "flows", f"{len(node.arrived_s):,}", bool(node.arrived_s)


def overload(rounds: Rounds) -> Iterator[Figure]:
    """1 h at 20 Hz beside busy cores: latency of two estimates at most, all is counted."""
    with live_node(_OFTEN) as node, busy_cores(os.cpu_count() or 1):
        yield from _played(node, rounds, 20)
        flows, sweeps = node.counts.get("flows_out", 0), node.num_published
        is_met = 0 < flows < (1 - _MIN_DROPPED) * sweeps
        yield "flows", f"{flows:,} of {sweeps:,} sweeps", is_met
        values = node.values
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
            node.check()
            between = with_stamp(good, FIRST_NS + node.num_good * INTERVAL_NS - INTERVAL_NS // 2)
            size = _HEAD_BYTES if random.random() < 0.5 else len(between)
            damaged, _ = mutated_bags.mutated(between[:size], random)
            node.points.publish(damaged + between[size:])
            node.num_published += 1
            node.publish(good)
            node.spin_for(0.02)
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
    before = len(node.arrived_s)
    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
    while len(node.arrived_s) == before and time.monotonic() < deadline_s:
        node.check()
        node.publish(good)
        node.spin_for(0.1)
    return len(node.arrived_s) > before


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
            node.spin_for(random.uniform(0, 1))
            node.process.kill()
    yield fates("node killed", found)


def runs(rounds: Rounds) -> Iterator[Figure]:
    """A signal ends `mnsf evaluate` or one of its processes: no traceback, `--resume` completes."""
    names = ("SIGKILL", "SIGINT", "SIGTERM", "SIGKILL of a process")
    found: dict[str, Counter[str]] = {name: Counter() for name in names}
    ends_s = [0.0]
    with tempfile.TemporaryDirectory(prefix="reliability_") as folder:
        street, out = Path(folder, "street"), Path(folder, "out")
        write_recording(SimulationSettings(duration_s=1.2, num_beams=16, num_columns=180), street)
        options = ("--methods", "zero,ego,online", "--workers", "2", "--pictures", "0")
        command = [*_MNSF, "evaluate", str(street), "--out", str(out), *options]
        start_s = time.monotonic()
        subprocess.run(command, check=True, capture_output=True)
        duration_s, expected = time.monotonic() - start_s, _figures(out)
        for number, random in rounds:
            shutil.rmtree(out, ignore_errors=True)
            name = names[number % len(names)]
            after_s, fate = _signalled(command, name, random, duration_s)
            if name in ("SIGINT", "SIGTERM"):
                ends_s.append(after_s)
            if _figures(out) != expected and (out / "run.json").exists():
                subprocess.run([*command, "--resume"], check=False, capture_output=True)
                fate = fate if _figures(out) == expected else "wrong: results differ"
            found[name][fate] += 1
    for name, counts in found.items():
        yield fates(name, counts)
    yield "ends in", f"{max(ends_s):.2f} s", max(ends_s) <= _MAX_END_S


def _figures(out: Path) -> str:
    """The errors of results.csv; empty without results."""
    file = out / "results.csv"
    return pd.read_csv(file)[list(_COLUMNS)].to_csv() if file.exists() else ""


def _signalled(
    command: Sequence[str], name: str, random: Random, duration_s: float
) -> tuple[float, str]:
    """Seconds from a signal to the end of a command, and its fate."""
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True)
        time.sleep(random.uniform(0, duration_s))
        victims = _session(process.pid)[1:] if name.endswith("process") else []
        start_s = time.monotonic()
        with suppress(ProcessLookupError):
            victim = int(random.choice(victims)) if victims else process.pid
            os.kill(victim, signal.Signals[name.split(maxsplit=1)[0]])
        status = process.wait(_END_TIMEOUT_S)
        after_s = time.monotonic() - start_s
        while left := _session(process.pid):
            if time.monotonic() > start_s + _END_TIMEOUT_S:
                return after_s, f"wrong: process {left[0]} is left"
            time.sleep(0.05)
        output.seek(0)
        said = output.read().decode(errors="replace")
    is_ours = "Traceback" in said and "mnsf_ros/" in said
    return after_s, f"wrong: {said[-300:]}" if is_ours else f"status {status}"


def _session(pid: int) -> list[int]:
    """Processes of a session, its leader first."""
    listed = subprocess.run(["pgrep", "-s", str(pid)], check=False, capture_output=True, text=True)
    return sorted(map(int, listed.stdout.split()))


def recordings(rounds: Rounds) -> Iterator[Figure]:
    """Damaged recordings of nine formats: no traceback, 60 s and 2 GB at most, no silent change."""
    folder = Path(tempfile.mkdtemp(prefix="mutated_bags_"))
    with limited_memory(mutated_bags.MAX_GB):
        found, bad = mutated_bags.run(rounds, folder)
    for name, counts in found.items():
        yield fates(name, counts, mutated_bags.BAD)
    for text in bad:
        yield "bad", text, False


PROMISES: Final = {
    "runs": Promise(200, "signals", runs),
    "recordings": Promise(10_000, "recordings", recordings),
    "nodes": Promise(200, "kills", killed_nodes),
    "clouds": Promise(10_000, "clouds", damaged_clouds),
    "overload": Promise(72_000, "sweeps", overload),
    "soak": Promise(864_000, "sweeps", soak),
}


if __name__ == "__main__":
    main()
