"""The tables of a run, for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from mnsf_ros.evaluation.argoverse_metrics import DYNAMIC, STATIC, THREE_WAY
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.mover_summary import FAST, MOVER_GROUPS, SLOW, MoverGroup
from mnsf_ros.evaluation.movers import LostBy
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.report.text_table import (
    NO_VALUE,
    Better,
    Column,
    TextTable,
    format_number,
    format_percent,
    table_of,
)

_ERRORS: Final = (
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
    table = table_of(errors.items(), _ERRORS, title, row_title)
    if times_ms is None:
        return table
    times = (format_number(times_ms.get(name, math.nan), 0) for name in errors)
    return table.with_column("time (ms)", times, min)


def main_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables that everybody wants to see, without those that would be empty."""
    objects = objects_table(summaries, (FAST, SLOW))
    tables = [*group_tables(summaries), movers_table(summaries), tracked_table(summaries), objects]
    return [table for table in tables if table is not None]


def group_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the errors of all, dynamic and static points, without tables that would be empty."""
    tables = []
    for group, words in _GROUP_TITLES.items():
        errors = {s.method: s.errors[group] for s in summaries if group in s.errors}
        counts = sorted({item.num_points for item in errors.values()})
        if any(counts):
            points = " to ".join(f"{count:,}" for count in dict.fromkeys(counts[:1] + counts[-1:]))
            times_ms = {s.method: s.time_ms for s in summaries} if group == "all" else None
            title = f"{words} ({points} points)"
            tables.append(errors_table(errors, title=title, times_ms=times_ms))
    return tables


def movers_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns how right methods are about what moves; None if nothing is known of that."""
    rows = [(one.method, one.movers) for one in summaries if one.movers is not None]
    return table_of(rows, _MOVERS, "Points called dynamic, and false movers") if rows else None


def tracked_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns how right methods are about tracked objects; None if nothing is known of that."""
    rows = [(one.method, one.movers) for one in summaries if one.movers is not None]
    table = table_of(rows, _TRACKED, "Tracked objects (median; after a stop: longest time)")
    is_known = any(cell != NO_VALUE for row in table.rows for cell in row[1:])
    return table if is_known else None


def objects_table(
    summaries: Sequence[MethodSummary], groups: Sequence[MoverGroup]
) -> TextTable | None:
    """Returns how well movers are found and followed; None without object ids in the truth."""
    rows = [
        (f"{summary.method}: {group.name}", known)
        for summary in summaries
        if summary.movers is not None
        for group in groups
        if (known := summary.movers.groups.get(group.name)) is not None
    ]
    title = "Objects that move, of 20 points and more"
    return table_of(rows, _OBJECTS, title, "movers") if rows else None


def losses_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns what lost movers; None if none were lost, or nobody says why."""
    lost = {s.method: s.movers.lost for s in summaries if s.movers is not None}
    known = [one.value for one in LostBy if any(one.value in own for own in lost.values())]
    rows = [[method, *(str(own.get(name, 0)) for name in known)] for method, own in lost.items()]
    title = "Mover-sweeps in which a mover was not found, by the step that lost it (to 50 m)"
    return TextTable(["method", *known], rows, title) if known else None


def confidence_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns whether points called dynamic deserve their confidence; None if there are none."""
    bands = dict.fromkeys(
        band for s in summaries if s.movers is not None for band in s.movers.confidence
    )
    values: dict[str, dict[str, float]] = {}
    for summary in summaries:
        if summary.movers is not None:
            known = summary.movers.confidence.items()
            values[f"{summary.method}: mean"] = {band: said for band, (said, _, _) in known}
            values[f"{summary.method}: deserved"] = {band: share for band, (_, share, _) in known}
    title = (
        "Confidence of points called dynamic: mean, and share of points with less than 0.1 m of "
        "error, by bands of confidence"
    )
    columns = {band: f"from {band}" for band in sorted(bands, key=float)}
    return _values_table(title, values, columns, better=None)


def consistency_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns the figures that need no truth; None if there are none."""
    columns = {
        "nearest_m": "nearest point, moved (m)",
        "zero_nearest_m": "nearest point, unmoved (m)",
        "cycle_m": "there and back (m)",
    }
    values = {s.method: s.consistency for s in summaries}
    return _values_table("Self-consistency (needs no truth)", values, columns, better=None)


def further_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables for those who look closer, without those that would be empty."""
    tables = [
        _values_table(
            "Three-way EPE (m) of Argoverse 2, over all points of all examples",
            {s.method: s.three_way_epe_m for s in summaries},
            {name: name for name in (*THREE_WAY, "mean")},
            decimals=4,
        ),
        _bucketed_table(summaries),
        _bins_table("EPE (m) in bins of range", {s.method: s.by_range for s in summaries}, "m"),
        _bins_table(
            "EPE (m) in bins of true speed without ego motion",
            {s.method: s.by_speed for s in summaries},
            "m/s",
        ),
        objects_table(summaries, MOVER_GROUPS[2:]),
        losses_table(summaries),
        confidence_table(summaries),
        work_table(summaries),
    ]
    return [table for table in tables if table is not None]


def work_table(summaries: Sequence[MethodSummary]) -> TextTable:
    """Returns how many examples there were, what became of them and how long they took."""
    title = "Examples (out of time: optimizations ended by their time budget)"
    return table_of(((one.method, one) for one in summaries), _WORK, title)


def _bucketed_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    # The mean over the classes comes last.
    classes = dict.fromkeys(name for s in summaries for name in s.bucketed if name != "mean")
    columns = [f"{name} {kind}" for name in (*classes, "mean") for kind in (DYNAMIC, STATIC)]
    return _values_table(
        "Bucket-normalized error of Argoverse 2 within 35 m, over all points of all examples: "
        "dynamic (1: ego motion only) and static (m)",
        {
            s.method: {f"{name} {k}": x for name, own in s.bucketed.items() for k, x in own.items()}
            for s in summaries
        },
        dict(zip(columns, columns, strict=True)),
    )


def _bins_table(
    title: str, bins: Mapping[str, Mapping[str, FlowErrors]], unit: str
) -> TextTable | None:
    limits = sorted({limit for errors in bins.values() for limit in errors}, key=float)
    values = {name: {x: item.epe_m for x, item in own.items()} for name, own in bins.items()}
    names = (f"{name} {unit}" for name in bin_names(limits))
    return _values_table(title, values, dict(zip(limits, names, strict=True)))


def bin_names(limits: Sequence[str]) -> list[str]:
    """Returns what bins are called, from their upper limits in ascending order."""
    names, low = [], "0"
    for limit in limits:
        names.append(f"{low}+" if limit == "inf" else f"{low}\N{EN DASH}{limit}")
        low = limit
    return names


def _values_table(
    title: str,
    values: Mapping[str, Mapping[str, float]],
    columns: Mapping[str, str],
    *,
    decimals: int = 3,
    better: Better | None = min,
) -> TextTable | None:
    """Method to key to value as a table, without columns without values; None if there are none."""
    known = [
        key for key in columns if not all(math.isnan(v.get(key, math.nan)) for v in values.values())
    ]
    if not known:
        return None
    rows = [
        [method, *(format_number(own.get(key, math.nan), decimals) for key in known)]
        for method, own in values.items()
    ]
    header = ["method", *(columns[key] for key in known)]
    return TextTable(header, rows, title, [None, *[better] * len(known)])
