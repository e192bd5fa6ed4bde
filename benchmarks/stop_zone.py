# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether moving points stop a robot in time, as nav2's collision monitor would use them.

    python benchmarks/stop_zone.py [--seeds 0 1] [--beams 32] [--columns 1024] [--document FILE]

People cross in front of a robot that stands, then of one that drives slowly, on a simulated street.
The robot must stop while enough points of `~/flow/moving` are in a box ahead of it. A flow is known
one sweep period and one estimate after its sweep.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from marked_section import add_document_option, replace_section
from numpy.typing import NDArray

from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.simulation.scenarios import Mover, Row, Stage
from mnsf_ros.simulation.scene import Scene
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.stage import staged_bodies
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

# Corners of the box in the frame of the lidar, metres; docs/recipes.md has the same for nav2.
LOW: Final = np.array([2.0, -1.5, -1.5])
HIGH: Final = np.array([8.0, 1.5, 0.3])
MIN_POINTS: Final = 10
# After a crossing, a stop is no false one for so long.
LET_GO_S: Final = 0.6
LIMITS: Final = {
    "stops after (s)": 0.6,
    "held (%)": 90.0,
    "lets go after (s)": 0.6,
    "false stops (%)": 5.0,
}
_STEP_S: Final = 0.01
_SPEEDS_M_S: Final = {"stands": 0.0, "drives at 1 m/s": 1.0}
DURATION_S: Final = 14.0


@dataclass(frozen=True, eq=False)
class Watched:
    """Sweep by sweep: its time in seconds, and how many points in the box move.

    Attributes:
        times_s: (T,) stamps.
        true: (T,) points that really move.
        said: (T,) points that the method calls dynamic; 0 of sweeps without a flow.
        estimate_s: CPU time of an estimate, median.
    """

    times_s: NDArray[np.float64]
    true: NDArray[np.int64]
    said: NDArray[np.int64]
    estimate_s: float


def main() -> None:
    """Prints the figures of each recording, and writes them into a document."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--beams", type=int, default=32)
    parser.add_argument("--columns", type=int, default=1024)
    add_document_option(parser)
    options = parser.parse_args()
    rows = []
    for name, speed_m_s in _SPEEDS_M_S.items():
        for seed in options.seeds:
            settings = SimulationSettings(
                seed=seed,
                duration_s=DURATION_S,
                num_beams=options.beams,
                num_columns=options.columns,
                ego_speed_m_s=speed_m_s,
                scenario="crossing",
            )
            seen = watch(settings)
            found = figures(seen, settings.interval_s + seen.estimate_s)
            rows.append([f"{name}, seed {seed}", *(f"{value:.2f}" for value in found.values())])
            print(*rows[-1], f"CPU of an estimate: {seen.estimate_s * 1e3:.0f} ms", flush=True)
    limits = ["limit", *(f"{limit:g}" for limit in LIMITS.values())]
    table = TextTable(
        ["robot", *LIMITS],
        [*rows, limits],
        f"{options.beams} beams, {options.columns} columns; the worst crossing of each recording",
    )
    if options.document:
        replace_section(options.document, "stop-zone", table.markdown())


def stage(speed_m_s: float) -> Stage:
    """People who cross ahead of the robot, some beside its way, and traffic in the other lane."""
    return Stage(
        "people who cross in front of a robot",
        (
            _crosser(5.0, 1.4, 2.0, speed_m_s, to_left=True),
            _crosser(6.5, 1.0, 6.0, speed_m_s, to_left=False),
            _crosser(4.5, 2.5, 11.0, speed_m_s, to_left=True),
            Mover("pedestrian", ((-60.0, -5.2), (300.0, -5.2)), 1.2, 55.0, 4, -7.0),
            Mover("car", ((300.0, 2.0), (-60.0, 2.0)), 8.0, 220.0, 4, -22.0),
        ),
        (
            Row("house", 15.7, 11.0),
            Row("house", -15.7, 11.0, 180.0),
            Row("car", 5.4, 6.4, share=0.7),
            Row("tree", -7.3, 13.0),
        ),
    )


def _crosser(
    ahead_m: float, speed: float, enters_s: float, ego_speed: float, *, to_left: bool
) -> Mover:
    """Someone who enters the box at a time, so far ahead of the robot."""
    edge_y, begin_y = (-3.5, -14.0) if to_left else (-0.5, 14.0)
    x = ahead_m + ego_speed * (enters_s + 1.5 / speed)
    at_m = abs(edge_y - begin_y) - speed * enters_s
    return Mover("pedestrian", ((x, begin_y), (x, -begin_y)), speed, at_m)


def watch(settings: SimulationSettings) -> Watched:
    """Runs the method over a recording, one triplet after the other, as the node does."""
    scene_stage = stage(settings.ego_speed_m_s)
    scene = Scene(*staged_bodies(scene_stage, settings), scene_stage.sensor)
    simulator = SweepSimulator(settings, scene)
    method = make_method("online", preset("online"))
    times_s, true, said, costs_s = [], [], [], []
    sweeps: list[Sweep] = []
    for index in range(settings.num_sweeps):
        taken = simulator.sweep(index)
        sweeps = [*sweeps[-2:], Sweep(taken.xyz, taken.stamp_ns, "lidar")]
        times_s.append(index * settings.interval_s)
        true.append(num_in_box(taken.xyz[taken.dynamic]))
        said.append(0)
        if len(sweeps) == 3:
            start_s = time.process_time()
            known = method.estimate(SweepTriplet(*sweeps)).over_ground
            costs_s.append(time.process_time() - start_s)
            said[-2] = num_in_box(sweeps[1].xyz[known.dynamic]) if known else 0
    return Watched(np.array(times_s), np.array(true), np.array(said), float(np.median(costs_s)))


def num_in_box(xyz: NDArray[np.float32]) -> int:
    """How many of (N, 3) points are in the box."""
    return int(np.count_nonzero(np.all((xyz >= LOW) & (xyz <= HIGH), axis=1)))


def figures(seen: Watched, delay_s: float) -> dict[str, float]:
    """The worst crossing: seconds until the stop and after it, and shares of time in %.

    `delay_s` after the stamp of a sweep its flow is known. The robot must stop while at least
    `MIN_POINTS` of the box really move.
    """
    clock = np.arange(seen.times_s[0] + delay_s, seen.times_s[-1], _STEP_S)
    stops = _newest(seen.times_s + delay_s, seen.said, clock) >= MIN_POINTS
    late_s, held, after_s = [], [], []
    excused = np.zeros(len(clock), bool)
    for begin_s, end_s in crossings(seen):
        excused |= (clock >= begin_s) & (clock <= end_s + LET_GO_S)
        inside = (clock >= begin_s) & (clock < end_s)
        first_s = next(iter(clock[inside & stops]), np.inf)
        late_s.append(first_s - begin_s)
        then = stops[inside & (clock >= first_s)]
        held.append(100.0 * then.mean() if len(then) else 0.0)
        going = clock[(clock >= end_s) & ~stops]
        after_s.append(next(iter(going), np.inf) - end_s)
    false = stops[~excused]
    values = (max(late_s), min(held), max(after_s), 100.0 * false.mean() if len(false) else 0.0)
    return dict(zip(LIMITS, map(float, values), strict=True))


def crossings(seen: Watched) -> Iterator[tuple[float, float]]:
    """Begin and end, seconds, of each time that something moves in the box."""
    is_needed = np.concatenate([[False], seen.true >= MIN_POINTS, [False]])
    begins = np.flatnonzero(is_needed[1:] & ~is_needed[:-1])
    ends = np.flatnonzero(is_needed[:-1] & ~is_needed[1:])
    for begin, end in zip(begins, ends, strict=True):
        yield seen.times_s[begin], seen.times_s[min(end, len(seen.times_s) - 1)]


def _newest(
    known_s: NDArray[np.float64], values: NDArray[np.int64], clock: NDArray[np.float64]
) -> NDArray[np.int64]:
    """The value that was known last at each time."""
    return values[np.clip(np.searchsorted(known_s, clock, side="right") - 1, 0, None)]


if __name__ == "__main__":
    main()
