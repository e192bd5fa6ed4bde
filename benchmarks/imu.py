# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What an IMU of consumer grade does for hard turns.

    python benchmarks/imu.py [--seeds A B] [--workers N] [--cache DIR] [--document FILE]

Runs over random worlds with hard turns, see movers.py, each with and without its turn rates.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from drives import TrueSweep, kept_world
from frame import Table, make_parser, publish
from movers import DURATION_S, add_world_options, in_processes
from scipy.spatial.transform import Rotation
from world_scores import NUM_FIRST, scored

from mnsf_ros.ego_motion.ego_motion import EgoMotion
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.settings import EgoMotionSettings

# Title to digits.
_FIGURES: Final = {
    "rotation (degrees)": 3,
    "horizontal (m)": 4,
    "vertical (m)": 4,
    "ego motion (ms)": 1,
    "EPE static (m)": 3,
    "EPE dynamic (m)": 3,
    "false movers a sweep": 3,
}


def main() -> None:
    """Measures all worlds, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    add_world_options(parser, (700, 714))
    options = parser.parse_args()
    seeds = range(*options.seeds)
    tasks = [(seed, options.cache) for seed in seeds]

    def measured() -> Iterator[Table]:
        figures = np.array(in_processes(_figures, tasks, options.workers))
        rows = [[name, *_cells(figures[:, i])] for i, name in enumerate(("without IMU", "with"))]
        title = f"Hard turns, seeds {seeds[0]} to {seeds[-1]}: mean/median over worlds"
        yield Table(title, ["", *_FIGURES], rows)

    publish("imu", measured(), options.document)


def _figures(seed: int, cache: Path) -> list[list[float]]:
    """Figures of a world without and with its IMU."""
    world = kept_world(seed, DURATION_S, "turns", cache)
    without = [replace(each, sweep=replace(each.sweep, turn_rates=None)) for each in world.sweeps]
    return [
        [*_ego_motion(each.sweeps), *_flow(each.sweeps)]
        for each in (replace(world, sweeps=without), world)
    ]


def _ego_motion(sweeps: list[TrueSweep]) -> list[float]:
    """Mean errors of the motion between stamps, and CPU time."""
    ego_motion, start_s = EgoMotion(EgoMotionSettings()), time.process_time()
    found = [ego_motion.pose_of(each.sweep).world_from_stamp for each in sweeps]
    time_ms = 1e3 * (time.process_time() - start_s) / len(sweeps)
    true = [each.pose for each in sweeps]
    errors = []
    for i in range(NUM_FIRST, len(sweeps) - 1):
        step, true_step = (np.linalg.inv(poses[i]) @ poses[i + 1] for poses in (found, true))
        off = np.linalg.inv(true_step) @ step
        angle_deg = np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude())
        errors.append((angle_deg, np.hypot(*off[:2, 3]), abs(off[2, 3])))
    return [*np.mean(errors, axis=0), time_ms]


def _flow(sweeps: list[TrueSweep]) -> list[float]:
    run = scored("online", sweeps, range(NUM_FIRST, len(sweeps) - 1))
    summary = summarize(one.row for one in run).iloc[0]
    names = ("errors.static.epe_m", "errors.dynamic.epe_m", "movers.ghosts_per_sweep")
    return [float(summary[name]) for name in names]


def _cells(figures: np.ndarray) -> list[str]:
    return [
        f"{np.nanmean(each):.{digits}f}/{np.nanmedian(each):.{digits}f}"
        for each, digits in zip(figures.T, _FIGURES.values(), strict=True)
    ]


if __name__ == "__main__":
    main()
