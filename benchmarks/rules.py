# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What each rule of the online method earns: each recording is run again without it.

    python benchmarks/rules.py [--half H ...] [--sweeps N] [--groups G ...] [--without RULE ...]
        [--document FILE]

On the recordings of movers.py, and on real drives by eye (movers_by_eye.py). A rule is taken out by
replacing one constant or function of `mnsf_ros/objects/`; sweeps are prepared once for all. Beside
the figures of all recordings together, the table names those that change most.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from marked_section import add_document_option, replace_section
from movers import KITTI, example_of, recordings
from movers_by_eye import DRIVES, seen_on
from online_recordings import TrueSweep
from rich.console import Console

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.metrics import end_point_errors, flow_errors
from mnsf_ros.evaluation.mover_summary import FAST, SLOW
from mnsf_ros.evaluation.movers import mover_row
from mnsf_ros.evaluation.results import MethodSummary, ResultRow, summarize
from mnsf_ros.evaluation.scoring import empty_row, true_motion
from mnsf_ros.methods import make_method
from mnsf_ros.objects import (
    first_guesses,
    motion_field,
    motion_fusion,
    reflections,
    scene,
    splitting,
    static_gate,
    suspects,
    visibility,
)
from mnsf_ros.objects.expectation import Expectation
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.tracks import Tracks
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.simulation.settings import SCENARIOS
from mnsf_ros.sweeps.sweep import SweepTriplet

_NOTHING: Final = np.zeros(0, np.int64)
_FAR: Final = 1e9
_EXPECTATION: Final[Callable[..., Expectation]] = Expectation.of


def _unexpected(objects: ObjectPoints, tracks: Tracks, *where: object) -> Expectation:
    return _EXPECTATION(objects, tracks.only(np.zeros(len(tracks), dtype=bool)), *where)


# The rule, where it is, and what is there instead.
_ALL: Final = "-"
RULES: Final[dict[str, tuple[Any, str, Any] | None]] = {
    _ALL: None,
    "older sweeps in the vote": (first_guesses, "_motions_over_time", lambda *_: []),
    "what tracks expect": (Expectation, "of", _unexpected),
    "following what is less likely": (static_gate, "_TENTATIVE", 0.0),
    "splitting": (scene, "split", lambda sweep, *_: sweep),
    "splitting of short objects": (splitting, "_SHORT_M", _FAR),
    "lower limits for long suspects": (suspects, "_LONG_M", _FAR),
    "attachments": (scene, "attached", lambda *_: (_NOTHING, _NOTHING)),
    "neighbours outvote the past": (motion_fusion, "_MAX_WORSE_M", _FAR),
    "no steep climbs": (motion_field, "_STEEPEST", np.float32(_FAR)),
    "reflections": (visibility, "reflections", lambda objects, *_: np.zeros(len(objects), int)),
    "rows of panes among reflections": (reflections, "_ROW_M", _FAR),
}
_NUM_NAMED: Final = 3

_HEADER: Final = (
    *("without", "fast found (%)", "walkers found (%)", "recall (%)", "precision (%)"),
    *("false movers per sweep", "EPE dynamic (m)", "CPU of an estimate (ms)"),
    *("found by eye", "false by eye", "changed most: found, false movers"),
)


def main() -> None:
    """Measures, prints the tables, and writes them into a document."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--half", nargs="+", default=["tuned", "reported"])
    parser.add_argument("--sweeps", type=int, default=18, help="of each simulated street")
    parser.add_argument("--groups", nargs="+", default=[KITTI, *SCENARIOS], help="only these")
    parser.add_argument("--without", nargs="+", choices=RULES, default=list(RULES))
    add_document_option(parser)
    options = parser.parse_args()
    rules = list(dict.fromkeys([_ALL, *options.without]))
    for half in options.half:
        rows: dict[str, list[ResultRow]] = {rule: [] for rule in rules}
        for recording in recordings(half, options.sweeps, options.groups):
            for rule, row in _measured(*recording, rules):
                rows[rule].append(row)
        table = _table(half, rows)
        Console(width=200).print(table)
        if options.document:
            replace_section(options.document, f"rules {half}", table.markdown())


@contextmanager
def without(rule: str) -> Iterator[None]:
    """Takes a rule out for a while."""
    with ExitStack() as stack:
        if (change := RULES[rule]) is not None:
            stack.enter_context(patch.object(*change))
        yield


def _measured(
    group: str, name: str, sweeps: list[TrueSweep], counted: range, rules: list[str]
) -> Iterator[tuple[str, ResultRow]]:
    """Runs over a recording and yields the rows of each rule; the group is the method."""
    first, *others = (make_method("online", preset("online")) for _ in range(len(rules) + 1))
    for index in range(1, counted[-1] + 1):
        triplet = SweepTriplet(*(each.sweep for each in sweeps[index - 1 : index + 2]))
        ready = first.prepare(triplet)
        example = example_of(name, index, sweeps, triplet)
        score = _scorer(example, group) if index in counted else None
        for rule, estimator in zip(rules, others, strict=True):
            start_s = time.process_time()
            with without(rule):
                estimate = estimator.estimate(triplet, prepared=ready)
            elapsed_ms = (time.process_time() - start_s) * 1e3
            if score is not None:
                yield rule, score(estimate, elapsed_ms)


def _scorer(example: Example, group: str) -> Callable[[FlowEstimate, float], ResultRow]:
    """Scores estimates of one sweep: movers and dynamic error only, the truth looked at once."""
    truth = example.truth
    rows = np.flatnonzero(truth.valid & example.scored)
    known, _ = true_motion(example, truth, rows)
    is_mover = truth.dynamic[rows]

    def score(estimate: FlowEstimate, time_ms: float) -> ResultRow:
        flow, true_flow = estimate.flow[rows], truth.flow[rows]
        errors_m = end_point_errors(flow, true_flow)
        movers = mover_row(known, estimate.over_ground, rows, errors_m, estimate.reason_of)
        errors = {"dynamic": flow_errors(flow[is_mover], true_flow[is_mover])}
        row = empty_row(example, group)
        return replace(row, time_ms=time_ms, movers=movers, errors=errors)

    return score


def _table(half: str, rows: dict[str, list[ResultRow]]) -> TextTable:
    by_group = {rule: {each.method: each for each in summarize(own)} for rule, own in rows.items()}
    cells = []
    for rule, own in rows.items():
        (summary,) = summarize([replace(row, method=rule) for row in own])
        movers = summary.movers
        known = (movers.groups.get(group.name) for group in (FAST, SLOW))
        found = (math.nan if group is None else group.found for group in known)
        shares = [f"{100 * share:.1f}" for share in (*found, movers.recall, movers.precision)]
        epe_m, time_ms = summary.errors["dynamic"].epe_m, np.median([row.time_ms for row in own])
        figures = f"{movers.ghosts_per_sweep:.3f}", f"{epe_m:.4f}", f"{time_ms:.1f}"
        changes = _changes(by_group[_ALL], by_group[rule])
        cells.append([rule, *shares, *figures, *_by_eye(rule), changes])
    return TextTable(list(_HEADER), cells, f"What each rule earns, {half} half")


def _changes(before: dict[str, MethodSummary], after: dict[str, MethodSummary]) -> str:
    """The recordings whose numbers of found mover-sweeps and of false movers change most."""
    changes = []
    for group, summary in after.items():
        found, false = (
            new - old for old, new in zip(_counts(before[group]), _counts(summary), strict=True)
        )
        changes.append((-abs(found) - abs(false), f"{group} {found:+d}, {false:+d}"))
    return "; ".join(text for size, text in sorted(changes)[:_NUM_NAMED] if size) or "none"


def _counts(summary: MethodSummary) -> tuple[int, int]:
    """Mover-sweeps that are found, and false movers."""
    movers = summary.movers
    known = [movers.groups[each.name] for each in (FAST, SLOW) if each.name in movers.groups]
    found = sum(each.found * each.num_sweeps for each in known if each.num_sweeps)
    return round(found), round(movers.ghosts_per_sweep * summary.num_examples)


def _by_eye(rule: str) -> tuple[str, str]:
    """Movers found and false movers of the real drives."""
    seen = []
    with without(rule):
        for drive in DRIVES:
            for are_pairs in (False, True):
                seen += seen_on(drive, are_pairs=are_pairs)
    found, known = sum(each.num_found for each in seen), sum(each.num_movers for each in seen)
    return f"{found} of {known}", str(sum(len(each.false) for each in seen))


if __name__ == "__main__":
    main()
