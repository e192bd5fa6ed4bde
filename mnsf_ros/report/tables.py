# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The tables of methods, for people."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from mnsf_ros.evaluation.argoverse_metrics import DYNAMIC, STATIC, THREE_WAY
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.mover_summary import FAST, MOVER_GROUPS, SLOW, MoverGroup, MoverSummary
from mnsf_ros.evaluation.movers import LostBy
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.report.text_table import (
    Better,
    Column,
    Table,
    TextTable,
    format_number,
    format_percent,
    made_table,
)

# The paper's column order.
ERRORS: Final = (
    Column("EPE (m)", lambda one: format_number(one.epe_m, 3), min),
    Column("Acc5 (%)", lambda one: format_percent(one.acc5), max),
    Column("Acc10 (%)", lambda one: format_percent(one.acc10), max),
    Column("Outliers (%)", lambda one: format_percent(one.outliers), min),
    Column("angle (rad)", lambda one: format_number(one.angle_error_rad, 3), min),
)
_MOVERS: Final = (
    Column("precision (%)", lambda one: format_percent(one.precision), max),
    Column("recall (%)", lambda one: format_percent(one.recall), max),
    Column("IoU (%)", lambda one: format_percent(one.iou), max),
    Column("false movers per sweep", lambda one: format_number(one.ghosts_per_sweep, 2), min),
    Column("sweeps with one (%)", lambda one: format_percent(one.ghost_sweeps), min),
)
_TRACKED: Final = (
    Column("velocity error (m/s)", lambda one: format_number(one.velocity_error_m_s, 2), min),
    Column("direction error (deg)", lambda one: format_number(one.direction_error_deg, 1), min),
    Column("after a stop (s)", lambda one: format_number(one.after_stop_s, 1), min),
)
_OBJECTS: Final = (
    Column("found (%)", lambda one: format_percent(one.found)),
    Column("flicker (%)", lambda one: format_percent(one.flicker)),
    Column("delay (s)", lambda one: format_number(one.delay_s, 2)),
    Column("movers", lambda one: f"{one.num_movers:,}"),
    Column("mover-sweeps", lambda one: f"{one.num_sweeps:,}"),
)
_WORK: Final = (
    Column("flows", lambda one: str(one.num_examples)),
    Column("failed", lambda one: str(one.num_failed)),
    Column("dropped", lambda one: str(one.num_dropped)),
    Column("time (ms)", lambda one: format_number(one.time_ms, 0), min),
    Column("latency (ms)", lambda one: format_number(one.latency_ms, 0)),
    Column("warm starts", lambda one: str(one.starts.get("warm", 0))),
    Column("out of time", lambda one: str(one.stop_reasons.get("time_budget", 0))),
)
_CONSISTENCY: Final = {
    "nearest_m": "nearest point, moved (m)",
    "zero_nearest_m": "nearest point, unmoved (m)",
    "cycle_m": "there and back (m)",
}
_GROUP_TITLES: Final = {
    "all": "All points",
    "dynamic": "Dynamic points",
    "static": "Static points",
}


def errors_table(
    errors: Mapping[str, FlowErrors],
    *,
    title: str = "",
    row_title: str = "method",
    times_ms: Mapping[str, float] | None = None,
) -> TextTable:
    """Returns errors in the paper's column order, shares in percent.

    `times_ms` has the wall time of one estimate for each row; None leaves the column out, and a row
    that is missing, or NaN, gets a dash.
    """
    return made_table(_errors(errors, title, row_title, times_ms))


def _errors(
    errors: Mapping[str, FlowErrors],
    title: str,
    row_title: str = "method",
    times_ms: Mapping[str, float] | None = None,
) -> Table:
    if times_ms is None:
        return Table(title, list(errors.items()), ERRORS, row_title)
    rows = [(name, (one, times_ms.get(name, math.nan))) for name, one in errors.items()]
    columns = [one._replace(cell=_of_first(one.cell)) for one in ERRORS]
    time = Column("time (ms)", lambda pair: format_number(pair[1], 0), min)
    return Table(title, rows, (*columns, time), row_title)


def _of_first(cell: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda pair: cell(pair[0])


def main_tables(summaries: Sequence[MethodSummary]) -> list[Table]:
    """Returns the tables that everybody wants to see."""
    tracked = "Tracked objects (median; after a stop: longest time)"
    return [
        *_group_tables(summaries),
        movers_table(summaries),
        Table(tracked, _movers_of(summaries), _TRACKED),
        objects_table(summaries, (FAST, SLOW)),
    ]


def movers_table(summaries: Iterable[MethodSummary]) -> Table:
    """Returns how well points are called dynamic, and how many false movers there are."""
    return Table("Points called dynamic, and false movers", _movers_of(summaries), _MOVERS)


def _movers_of(summaries: Iterable[MethodSummary]) -> list[tuple[str, MoverSummary]]:
    """What is known of movers, of each method of which anything is."""
    return [(one.method, one.movers) for one in summaries if one.movers is not None]


def _group_tables(summaries: Sequence[MethodSummary]) -> Iterator[Table]:
    """The errors of all, dynamic and static points."""
    for group, words in _GROUP_TITLES.items():
        errors = {s.method: s.errors[group] for s in summaries if group in s.errors}
        counts = sorted({item.num_points for item in errors.values()})
        if any(counts):
            points = " to ".join(f"{count:,}" for count in dict.fromkeys(counts[:1] + counts[-1:]))
            times_ms = {s.method: s.time_ms for s in summaries} if group == "all" else None
            yield _errors(errors, f"{words} ({points} points)", times_ms=times_ms)


def objects_table(summaries: Iterable[MethodSummary], groups: Collection[MoverGroup]) -> Table:
    """Returns how well movers are found and followed."""
    rows = [
        (f"{method}: {group.name}", movers.groups[group.name])
        for method, movers in _movers_of(summaries)
        for group in groups
        if group.name in movers.groups
    ]
    return Table("Objects that move, of 20 points and more", rows, _OBJECTS, "movers")


def consistency_table(summaries: Iterable[MethodSummary]) -> Table:
    """Returns the figures that need no truth."""
    rows = [(one.method, one.consistency) for one in summaries]
    columns = [_value(key, title, better=None) for key, title in _CONSISTENCY.items()]
    return Table("Self-consistency (needs no truth)", rows, columns)


def further_tables(summaries: Sequence[MethodSummary]) -> list[Table]:
    """Returns the tables for those who look closer."""
    return [
        Table(
            "Three-way EPE (m) of Argoverse 2, over all points of all examples",
            [(one.method, one.three_way_epe_m) for one in summaries],
            [_value(name, name, decimals=4) for name in (*THREE_WAY, "mean")],
        ),
        _bucketed(summaries),
        _bins("EPE (m) in bins of range", {s.method: s.by_range for s in summaries}, "m"),
        _bins(
            "EPE (m) in bins of true speed without ego motion",
            {s.method: s.by_speed for s in summaries},
            "m/s",
        ),
        objects_table(summaries, MOVER_GROUPS[2:]),
        losses_table(summaries),
        confidence_table(summaries),
        work_table(summaries),
    ]


def losses_table(summaries: Iterable[MethodSummary]) -> Table:
    """Returns what lost movers, as far as anybody says why."""
    rows = _movers_of(summaries)
    known = [one.value for one in LostBy if any(one.value in own.lost for _, own in rows)]
    title = "Mover-sweeps in which a mover was not found, by the step that lost it (to 50 m)"
    return Table(title, rows, [Column(name, _count(name)) for name in known])


def _count(name: str) -> Callable[[MoverSummary], str]:
    return lambda movers: str(movers.lost.get(name, 0))


def confidence_table(summaries: Iterable[MethodSummary]) -> Table:
    """Returns whether points called dynamic deserve their confidence."""
    rows: list[tuple[str, dict[str, float]]] = []
    for method, movers in _movers_of(summaries):
        known = movers.confidence.items()
        rows.append((f"{method}: mean", {band: said for band, (said, _, _) in known}))
        rows.append((f"{method}: deserved", {band: share for band, (_, share, _) in known}))
    title = (
        "Confidence of points called dynamic: mean, and share of points with less than 0.1 m of "
        "error, by bands of confidence"
    )
    bands = sorted({band for _, own in rows for band in own}, key=float)
    return Table(title, rows, [_value(band, f"from {band}", better=None) for band in bands])


def work_table(summaries: Iterable[MethodSummary]) -> Table:
    """Returns how many examples there were, what became of them and how long they took."""
    title = "Examples (out of time: optimizations ended by their time budget)"
    return Table(title, [(one.method, one) for one in summaries], _WORK)


def _bucketed(summaries: Sequence[MethodSummary]) -> Table:
    # The mean over the classes comes last.
    classes = dict.fromkeys(name for s in summaries for name in s.bucketed if name != "mean")
    names = [f"{name} {kind}" for name in (*classes, "mean") for kind in (DYNAMIC, STATIC)]
    rows = [
        (
            s.method,
            {f"{name} {k}": x for name, own in s.bucketed.items() for k, x in own.items()},
        )
        for s in summaries
    ]
    title = (
        "Bucket-normalized error of Argoverse 2 within 35 m, over all points of all examples: "
        "dynamic (1: ego motion only) and static (m)"
    )
    return Table(title, rows, [_value(name, name) for name in names])


def _bins(title: str, bins: Mapping[str, Mapping[str, FlowErrors]], unit: str) -> Table:
    limits = sorted({limit for errors in bins.values() for limit in errors}, key=float)
    rows = [(name, {x: item.epe_m for x, item in own.items()}) for name, own in bins.items()]
    names = zip(limits, bin_names(limits), strict=True)
    return Table(title, rows, [_value(limit, f"{name} {unit}") for limit, name in names])


def bin_names(limits: Sequence[str]) -> list[str]:
    """Returns what bins are called, from their upper limits in ascending order."""
    names, low = [], "0"
    for limit in limits:
        names.append(f"{low}+" if limit == "inf" else f"{low}\N{EN DASH}{limit}")
        low = limit
    return names


def _value(key: str, title: str, *, decimals: int = 3, better: Better | None = min) -> Column:
    """A column of one of the values that rows have by name, if any row has it."""

    def cell(values: Mapping[str, float]) -> str:
        return format_number(values.get(key, math.nan), decimals)

    return Column(title, cell, better, is_optional=True)
