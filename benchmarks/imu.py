# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What an IMU of consumer grade does for hard turns.

    python benchmarks/imu.py [--seeds A B] [--method NAME] [--workers N] [--cache DIR]
        [--document FILE]

Runs over random worlds with hard turns, see movers.py, each with and without its turn rates.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from drives import TrueSweep, kept_world
from frame import Table, make_parser, publish
from movers import DURATION_S, add_world_options, in_processes
from world_scores import WorldScore, world_score

_SCENARIO: Final = "turns"
_FIGURES: Final = {
    "ego rotation": "ego rotation (degrees)",
    "ego motion": "ego motion (m)",
    "false movers": "false movers a sweep",
    "recall": "recall",
    "dynamic EPE": "EPE dynamic (m)",
    "static EPE": "EPE static (m)",
    "CPU": "CPU (ms)",
}


def main() -> None:
    """Measures all worlds, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    add_world_options(parser, (700, 716))
    parser.add_argument("--method", default="online", help="name")
    options = parser.parse_args()
    seeds = range(*options.seeds)
    tasks = [(seed, imu, options.method, options.cache) for seed in seeds for imu in (False, True)]

    def measured() -> Iterator[Table]:
        scores = in_processes(_score, tasks, options.workers)
        header = ["", "worlds", *_FIGURES.values()]
        title = f"Hard turns, seeds {seeds[0]} to {seeds[-1]}, `{options.method}`: mean/median"
        rows = []
        for kind in (True, False):
            own = [score for has_times, score in scores if has_times == kind]
            name = "points have times" if kind else "sweeps of one moment"
            # Each world without, and then with its IMU.
            rows += [
                [f"{name}, without IMU", *_cells(own[::2])],
                [f"{name}, with", *_cells(own[1::2])],
            ]
        yield Table(title, header, rows)

    publish("imu", measured(), options.document)


def _score(seed: int, has_imu: bool, method: str, cache: Path) -> tuple[bool, WorldScore]:
    """Whether points of a world have times, and its score."""
    world = kept_world(seed, DURATION_S, _SCENARIO, cache)
    has_times = world.sweeps[0].sweep.times_s is not None
    if not has_imu:
        world = replace(world, sweeps=[_without_imu(each) for each in world.sweeps])
    return has_times, world_score(world, _SCENARIO, method)


def _without_imu(each: TrueSweep) -> TrueSweep:
    return replace(each, sweep=replace(each.sweep, turn_rates=None))


def _cells(scores: Sequence[WorldScore]) -> list[str]:
    figures = [[one.figures[name] for one in scores] for name in _FIGURES]
    means = (f"{np.nanmean(each):.3f}/{np.nanmedian(each):.3f}" for each in figures)
    return [str(len(scores)), *means]


if __name__ == "__main__":
    main()
