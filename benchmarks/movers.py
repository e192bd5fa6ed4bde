# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How well `online` finds and follows movers, against targets.

    python benchmarks/movers.py [--half tuned reported] [--sweeps N] [--groups G ...]
        [--document FILE]

Runs over consecutive sweeps of KITTI 0005, if the shared data is there (see drives.py), and of
of random worlds, and scores them as `mnsf evaluate` does. Constants were tuned on the first
half of KITTI and on some seeds; the other half is reported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd
from drives import TrueSweep, random_world, real_sweeps
from frame import Table, Target, make_parser, publish

from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.mover_summary import FAST, SLOW
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.scoring import scored_row
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import SweepTriplet

KITTI: Final = "KITTI 0005"
PAIRS: Final = "KITTI 0005, two sweeps"
WORLDS: Final = "random worlds"
_SEEDS: Final = {"tuned": range(10), "reported": range(500, 510)}
# The first sweeps have no past and are not scored.
_NUM_FIRST: Final = 3
# A band of confidence with fewer points is not judged.
_MIN_BAND_POINTS: Final = 500
_NORMALIZED: Final = {
    "car": ("CAR", 0.15),
    "two-wheeler": ("WHEELED_VRU", 0.25),
    "pedestrian": ("PEDESTRIAN", 0.35),
}
_MAX_DYNAMIC_M: Final = {KITTI: 0.04}

# Group, name, sweeps, and the numbers of the scored ones.
Recording = tuple[str, str, list[TrueSweep], range]


def main() -> None:
    """Measures the halves asked for, prints their tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--half", nargs="+", choices=_SEEDS, default=["reported"])
    parser.add_argument("--sweeps", type=int, default=24, help="of each random world")
    parser.add_argument("--groups", nargs="+", help="only these")
    options = parser.parse_args()

    def measured() -> Iterator[Table]:
        for half in options.half:
            found = recordings(half, options.sweeps, options.groups)
            yield from tables(half, [row for recording in found for row in scored(*recording)])

    publish("movers", measured(), options.document)


def recordings(half: str, num_sweeps: int, groups: list[str] | None) -> Iterator[Recording]:
    """Yields the recordings of a half."""
    kitti = real_sweeps("kitti_0005")
    middle = len(kitti) // 2
    counted = range(_NUM_FIRST, middle) if half == "tuned" else range(middle, len(kitti) - 1)
    for group in (KITTI, PAIRS):
        if kitti and (groups is None or group in groups):
            yield group, group, kitti, counted
    for seed in _SEEDS[half] if groups is None or WORLDS in groups else ():
        world = random_world(seed, num_sweeps)
        yield world.lidar, f"world {seed}", world.sweeps, range(_NUM_FIRST, num_sweeps - 1)


def scored(group: str, name: str, sweeps: list[TrueSweep], counted: range) -> Iterator[ResultRow]:
    """Runs over a recording and yields its rows, the group as method."""
    estimator, are_pairs = make_method("online", preset("online")), group == PAIRS
    for index in range(counted[0] if are_pairs else 1, counted[-1] + 1):
        previous, current, next_ = (each.sweep for each in sweeps[index - 1 : index + 2])
        if are_pairs:
            estimator, previous = make_method("online", preset("online")), None
        triplet = SweepTriplet(previous, current, next_)
        estimate = estimator.estimate(triplet)
        if index in counted:
            yield scored_row(_example(name, index, sweeps, triplet), group, estimate)


def _example(name: str, index: int, sweeps: list[TrueSweep], triplet: SweepTriplet) -> Example:
    """The current sweep of a triplet with its truth."""
    current, next_ = sweeps[index : index + 2]
    # With points that the method takes for ground, such as the bottoms of vehicles.
    valid = current.scored & crop_mask(current.sweep.xyz, preset("online").crop)
    truth = FlowTruth(
        current.sweep.stamp_ns,
        current.flow,
        valid,
        current.dynamic,
        current.ground,
        current.class_id,
        (current.body + 1).astype(np.uint32),
    )
    motion = np.linalg.inv(next_.pose) @ current.pose
    triplet = SweepTriplet(None, triplet.current, triplet.next, next_from_current=motion)
    return Example(name, index, triplet, truth)


def tables(half: str, rows: list[ResultRow]) -> Iterator[Table]:
    """Figures of the real drive and of all worlds together; figures and targets of each group."""
    groups = summarize(rows)
    judged = {name: list(targets(group)) for name, group in groups.iterrows()}
    known = [each for found in judged.values() for each in found if each.verdict]
    num_met = sum(each.verdict == "met" for each in known)
    worlds = [_renamed(row) for row in rows if row.method not in (KITTI, PAIRS)]
    main = pd.concat([groups[groups.index.isin([KITTI, PAIRS])], summarize(worlds)])
    title = f"Movers, {half} half: {num_met} of {len(known)} targets met"
    yield Table(title, _HEADER, [_cells(group) for _, group in main.iterrows()])
    details = [_cells(group) for _, group in groups.iterrows()]
    yield Table("Each group", _HEADER, details, is_detail=True)
    missed = [
        [name, *each.row()]
        for name, found in judged.items()
        for each in found
        if each.verdict == "MISSED"
    ]
    yield Table("Missed targets", ["", "figure", "target", "measured", ""], missed, is_detail=True)


def _renamed(row: ResultRow) -> ResultRow:
    return replace(row, method=WORLDS)


_HEADER: Final = (
    *("", "fast found (%)", "slow found (%)", "recall (%)", "precision (%)"),
    *("false movers a sweep", "EPE dynamic (m)", "EPE static (m)"),
)


def _cells(summary: pd.Series) -> list[str]:
    names = (f"{FAST.name}.found", f"{SLOW.name}.found", "recall", "precision")
    figures = [
        *(f"{100 * summary.get(f'movers.{name}', math.nan):.1f}" for name in names),
        f"{summary['movers.ghosts_per_sweep']:.2f}",
        *(f"{summary[f'errors.{part}.epe_m']:.3f}" for part in ("dynamic", "static")),
    ]
    return [str(summary.name), *("" if figure == "nan" else figure for figure in figures)]


def targets(summary: pd.Series) -> Iterator[Target]:
    """Yields the targets of a group; a figure that its recordings do not have is NaN."""

    def score(name: str, factor: float = 1.0) -> float:
        return factor * float(summary.get(f"movers.{name}", math.nan))

    if math.isnan(score("ghost_sweeps")):
        return
    for group, least in ((FAST, 97.0), (SLOW, 90.0)):
        if score(f"{group.name}.num_movers") > 0:
            name, found = f"{group.name} (% of sweeps)", score(f"{group.name}.found", 100)
            yield Target(f"found, {name}", least, found, is_minimum=True)
            yield Target(f"lost and found again, {name}", 1.0, score(f"{group.name}.flicker", 100))
    if summary["errors.dynamic.num_points"]:
        precision = score("precision", 100)
        yield Target("precision of dynamic points (%)", 95.0, precision, is_minimum=True)
    else:
        yield Target("sweeps with a false mover (%)", 1.0, score("ghost_sweeps", 100))
    yield Target("called a mover after a stop (s)", 0.5, score("after_stop_s"))
    limit_m = _MAX_DYNAMIC_M.get(str(summary.name))
    if limit_m is not None:
        yield Target("dynamic EPE (m)", limit_m, summary["errors.dynamic.epe_m"])
    for kind, (bucket, limit) in _NORMALIZED.items():
        error = summary.get(f"bucketed.{bucket}.dynamic", math.nan)
        yield Target(f"normalized error, {kind}", limit, error)
    yield Target("velocity error (m/s)", 0.2, score("velocity_error_m_s"))
    yield Target("direction error (deg)", 5.0, score("direction_error_deg"))
    yield Target("confidence: largest deviation of a band", 0.05, _deviation(summary))


def _deviation(summary: pd.Series) -> float:
    """Largest difference of mean confidence and deserved share; NaN without bands."""
    counts = summary.filter(regex=r"^movers\.confidence\..*\.num_points$")
    bands = [name.removesuffix(".num_points") for name in counts.index[counts >= _MIN_BAND_POINTS]]
    off = (abs(summary[f"{band}.mean"] - summary[f"{band}.deserved"]) for band in bands)
    return max(off, default=math.nan)


if __name__ == "__main__":
    main()
