# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How well movers are found and followed, against the targets of the project.

    python benchmarks/movers.py [--half tuned reported] [--sweeps N] [--document FILE]

Runs the online preset over consecutive sweeps of KITTI 0005, where it is at hand (see
online_recordings.py), and of every simulated scenario, and scores them as `mnsf evaluate` does.
Constants are tuned on the first half of KITTI and on some seeds; the other half is reported.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from marked_section import add_document_option, replace_section
from online_recordings import TrueSweep, real_sweeps, simulated_sweeps
from rich.console import Console

from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.mover_summary import FAST, SLOW, MoverSummary
from mnsf_ros.evaluation.results import MethodSummary, ResultRow, summarize
from mnsf_ros.evaluation.scoring import scored_row
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.report.tables import confidence_table, losses_table, movers_table, objects_table
from mnsf_ros.report.text_table import TextTable, format_number, made_tables
from mnsf_ros.simulation.settings import SCENARIOS
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import SweepTriplet

KITTI: Final = "KITTI 0005"
PAIRS: Final = "KITTI 0005, two sweeps"
# Seeds of the scenarios; the hard one has more, because its streets differ most.
_SEEDS: Final = {"tuned": (0,), "reported": (3,)}
_HARD_SEEDS: Final = {"tuned": (0, 1, 2), "reported": (3, 4, 5)}
_HARD: Final = "street_that_hurts"
# What stops does so later than the sweeps asked for.
_MIN_SWEEPS: Final = {"stop_and_go": 45}
# The first sweeps have no past and are not scored.
_NUM_FIRST: Final = 3
# A band of confidence counts with so many points.
_MIN_BAND_POINTS: Final = 500


@dataclass(frozen=True)
class Target:
    """A figure and what is wanted of it.

    Attributes:
        text: What it is, with unit.
        limit: The figure must be at least this, or at most.
        measured: The figure; NaN where there is nothing to judge.
        is_minimum: Whether more is better.
    """

    text: str
    limit: float
    measured: float
    is_minimum: bool = False

    @property
    def title(self) -> str:
        """What it is and its limit."""
        return f"{self.text}, {'at least' if self.is_minimum else 'at most'} {self.limit:g}"

    @property
    def is_met(self) -> bool:
        """Whether the figure is as wanted."""
        return self.measured >= self.limit if self.is_minimum else self.measured <= self.limit


def main() -> None:
    """Measures the halves asked for, prints their tables, and writes them into a document."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--half", nargs="+", choices=_SEEDS, default=["reported"])
    parser.add_argument("--sweeps", type=int, default=24, help="of each simulated street")
    parser.add_argument("--groups", nargs="+", help="only these: scenarios, or names of data")
    add_document_option(parser)
    options = parser.parse_args()
    console, texts = Console(width=120), []
    for half in options.half:
        times_ms: list[float] = []
        rows = [
            row
            for recording in recordings(half, options.sweeps, options.groups)
            for row in scored(*recording, times_ms)
        ]
        for table in tables(half, summarize(rows)):
            console.print(table)
            texts.append(table.markdown())
        texts.append(f"CPU time of an estimate, {half} half: {np.median(times_ms):.0f} ms (median)")
        console.print(texts[-1])
    if options.document:
        replace_section(options.document, "movers", "\n".join(texts))


def recordings(
    half: str, num_sweeps: int, groups: list[str] | None
) -> Iterator[tuple[str, str, list[TrueSweep], range]]:
    """Group, name, sweeps, and the numbers of those that count."""
    kitti = real_sweeps("kitti_0005")
    middle = len(kitti) // 2
    counted = range(_NUM_FIRST, middle) if half == "tuned" else range(middle, len(kitti) - 1)
    for group in (KITTI, PAIRS):
        if kitti and (groups is None or group in groups):
            yield group, group, kitti, counted
    for group in SCENARIOS:
        if groups is None or group in groups:
            for seed in (_HARD_SEEDS if group == _HARD else _SEEDS)[half]:
                number = max(num_sweeps, _MIN_SWEEPS.get(group, 0))
                sweeps = simulated_sweeps(seed, number, scenario=group)
                yield group, f"{group} {seed}", sweeps, range(_NUM_FIRST, len(sweeps) - 1)


def scored(
    group: str, name: str, sweeps: list[TrueSweep], counted: range, times_ms: list[float]
) -> Iterator[ResultRow]:
    """Runs over a recording and yields its rows, the group as method; adds CPU times in ms."""
    estimator, are_pairs = make_method("online", preset("online")), group == PAIRS
    for index in range(counted[0] if are_pairs else 1, counted[-1] + 1):
        previous, current, next_ = (each.sweep for each in sweeps[index - 1 : index + 2])
        if are_pairs:
            estimator, previous = make_method("online", preset("online")), None
        triplet = SweepTriplet(previous, current, next_)
        start_s = time.process_time()
        estimate = estimator.estimate(triplet)
        elapsed_ms = (time.process_time() - start_s) * 1e3
        if index in counted:
            times_ms += [] if are_pairs else [elapsed_ms]
            yield scored_row(example_of(name, index, sweeps, triplet), group, estimate, elapsed_ms)


def example_of(name: str, index: int, sweeps: list[TrueSweep], triplet: SweepTriplet) -> Example:
    """The current sweep of a triplet with its truth."""
    current, next_ = sweeps[index : index + 2]
    # Including points that were taken for ground, for example the bottoms of vehicles.
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


def tables(half: str, summaries: list[MethodSummary]) -> Iterator[TextTable]:
    """Errors, points, objects and confidence of each group, and the targets."""
    rows = [
        [
            summary.method,
            *(f"{summary.errors[part].epe_m:.4f}" for part in ("dynamic", "static")),
            *(format_number(_normalized(summary, kind), 2) for kind in _NORMALIZED),
            f"{summary.time_ms:.0f}",
        ]
        for summary in summaries
    ]
    header = ["", "EPE dynamic (m)", "EPE static (m)", *_NORMALIZED, "CPU time (ms)"]
    yield TextTable(header, rows, f"Errors, {half} half; dynamic errors of kinds are normalized")
    further = (
        movers_table(summaries),
        objects_table(summaries, (FAST, SLOW)),
        losses_table(summaries),
        confidence_table(summaries),
    )
    yield from made_tables(further)
    yield _targets_table(half, summaries)


def _targets_table(half: str, summaries: list[MethodSummary]) -> TextTable:
    """One row for each group, one column for each target that any of them can be judged by."""
    judged = {
        summary.method: {
            target.title: f"{target.measured:.3g} {'met' if target.is_met else 'MISSED'}"
            for target in targets(summary)
            if not math.isnan(target.measured)
        }
        for summary in summaries
    }
    titles = list(dict.fromkeys(title for cells in judged.values() for title in cells))
    rows = [[name, *(cells.get(title, "-") for title in titles)] for name, cells in judged.items()]
    num_met = sum(cell.endswith("met") for row in rows for cell in row)
    num_judged = sum(map(len, judged.values()))
    title = f"Targets, {half} half: {num_met} of {num_judged} met"
    return TextTable(["", *titles], rows, title)


_NORMALIZED: Final = {"car": "CAR", "two-wheeler": "WHEELED_VRU", "pedestrian": "PEDESTRIAN"}
_MAX_NORMALIZED: Final = {"car": 0.15, "two-wheeler": 0.25, "pedestrian": 0.35}
_MAX_DYNAMIC_M: Final = {KITTI: 0.04}


def targets(summary: MethodSummary) -> Iterator[Target]:
    """The targets that a group can be judged by."""
    movers = summary.movers
    if movers is None:
        return
    for group, least in ((FAST, 97.0), (SLOW, 90.0)):
        if (known := movers.groups.get(group.name)) is not None:
            yield Target(
                f"found, {group.name} (% of sweeps)", least, 100 * known.found, is_minimum=True
            )
            yield Target(
                f"lost and found again, {group.name} (% of sweeps)", 1.0, 100 * known.flicker
            )
    if summary.errors["dynamic"].num_points:
        yield Target("called dynamic and are (%)", 95.0, 100 * movers.precision, is_minimum=True)
    else:
        yield Target("standing: sweeps with a false mover (%)", 1.0, 100 * movers.ghost_sweeps)
    yield Target("called a mover after a stop (s)", 0.5, movers.after_stop_s)
    if summary.method in _MAX_DYNAMIC_M:
        limit_m = _MAX_DYNAMIC_M[summary.method]
        yield Target("dynamic EPE (m)", limit_m, summary.errors["dynamic"].epe_m)
    for kind, limit in _MAX_NORMALIZED.items():
        yield Target(f"normalized error, {kind}", limit, _normalized(summary, kind))
    yield Target("velocity error (m/s)", 0.2, movers.velocity_error_m_s)
    yield Target("direction error (deg)", 5.0, movers.direction_error_deg)
    yield Target("confidence: largest deviation of a band", 0.05, _deviation(movers))


def _normalized(summary: MethodSummary, kind: str) -> float:
    return summary.bucketed.get(_NORMALIZED[kind], {}).get("dynamic", math.nan)


def _deviation(movers: MoverSummary) -> float:
    """Largest difference of mean confidence and share that deserves it; NaN without bands."""
    bands = [band for band in movers.confidence.values() if band[2] >= _MIN_BAND_POINTS]
    return max((abs(said - share) for said, share, _ in bands), default=math.nan)


if __name__ == "__main__":
    main()
