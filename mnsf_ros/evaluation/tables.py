"""The tables of a run, for people."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from mnsf_ros.evaluation.argoverse_metrics import DYNAMIC, STATIC, THREE_WAY
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.mover_summary import FAST, MOVER_GROUPS, SLOW, MoverGroup
from mnsf_ros.evaluation.movers import LostBy
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.evaluation.text_table import Better, TextTable, format_number, format_percent

_ERROR_COLUMNS: Final = ("EPE (m)", "Acc5 (%)", "Acc10 (%)", "Outliers (%)", "angle (rad)")
_ERROR_BETTER: Final[tuple[Better, ...]] = (min, max, max, min, min)
_TIME_COLUMN: Final = "time (ms)"


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
    header = [row_title, *_ERROR_COLUMNS]
    rows = [[name, *_error_cells(row_errors)] for name, row_errors in errors.items()]
    if times_ms is not None:
        header.append(_TIME_COLUMN)
        for row in rows:
            row.append(format_number(times_ms.get(row[0], math.nan), 0))
    better = (None, *_ERROR_BETTER, *([] if times_ms is None else [min]))
    return TextTable(header, rows, title, better)


def _error_cells(errors: FlowErrors) -> list[str]:
    return [
        format_number(errors.epe_m, 3),
        format_percent(errors.acc5),
        format_percent(errors.acc10),
        format_percent(errors.outliers),
        format_number(errors.angle_error_rad, 3),
    ]


def main_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables that everybody wants to see, without those that would be empty."""
    consistency = consistency_table(summaries)
    objects = objects_table(summaries, (FAST, SLOW))
    tables = [*group_tables(summaries), movers_table(summaries), objects]
    return [table for table in (*tables, consistency) if table is not None]


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
    columns: dict[str, tuple[str, int, float, Better]] = {
        "precision": ("precision (%)", 1, 100.0, max),
        "recall": ("recall (%)", 1, 100.0, max),
        "iou": ("IoU (%)", 1, 100.0, max),
        "ghosts_per_sweep": ("false movers per sweep", 2, 1.0, min),
        "ghost_sweeps": ("sweeps with one (%)", 1, 100.0, min),
        "velocity_error_m_s": ("velocity error (m/s)", 2, 1.0, min),
        "direction_error_deg": ("direction error (deg)", 1, 1.0, min),
        "after_stop_s": ("after a stop (s)", 1, 1.0, min),
    }
    rows = [
        [
            summary.method,
            *(
                format_number(factor * getattr(summary.movers, key), decimals)
                for key, (_, decimals, factor, _) in columns.items()
            ),
        ]
        for summary in summaries
        if summary.movers is not None
    ]
    header = ["method", *(title for title, *_ in columns.values())]
    better = [None, *(better for *_, better in columns.values())]
    title = "Points called dynamic, and tracked objects (median; after a stop: longest time)"
    return TextTable(header, rows, title, better) if rows else None


def objects_table(
    summaries: Sequence[MethodSummary], groups: Sequence[MoverGroup]
) -> TextTable | None:
    """Returns how well movers are found and followed; None without object ids in the truth."""
    rows = [
        [
            f"{summary.method}: {group.name}",
            format_percent(known.found),
            format_percent(known.flicker),
            format_number(known.delay_s, 2),
            f"{known.num_movers:,}",
            f"{known.num_sweeps:,}",
        ]
        for summary in summaries
        if summary.movers is not None
        for group in groups
        if (known := summary.movers.groups.get(group.name)) is not None
    ]
    header = ["movers", "found (%)", "flicker (%)", "delay (s)", "movers", "mover-sweeps"]
    title = "Objects that move, of 20 points and more"
    return TextTable(header, rows, title) if rows else None


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
        _bands_table(
            "EPE (m) by range (upper limit of each band)",
            {s.method: s.by_range for s in summaries},
            lambda limit: "farther" if limit == "inf" else f"{limit} m",
        ),
        _bands_table(
            "EPE (m) by true speed without ego motion (upper limit of each band)",
            {s.method: s.by_speed for s in summaries},
            lambda limit: "faster" if limit == "inf" else f"{limit} m/s",
        ),
        objects_table(summaries, MOVER_GROUPS[2:]),
        losses_table(summaries),
        confidence_table(summaries),
        work_table(summaries),
    ]
    return [table for table in tables if table is not None]


def work_table(summaries: Sequence[MethodSummary]) -> TextTable:
    """Returns how many examples there were, what became of them and how long they took."""
    header = ["method", "flows", "failed", "dropped", "time (ms)", "latency (ms)"]
    better = [None, None, None, None, min, None, None, None]
    header += ["warm starts", "out of time"]
    rows = [
        [
            summary.method,
            *map(str, (summary.num_examples, summary.num_failed, summary.num_dropped)),
            format_number(summary.time_ms, 0),
            format_number(summary.latency_ms, 0),
            str(summary.starts.get("warm", 0)),
            str(summary.stop_reasons.get("time_budget", 0)),
        ]
        for summary in summaries
    ]
    title = "Examples (out of time: optimizations ended by their time budget)"
    return TextTable(header, rows, title, better)


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


def _bands_table(
    title: str, bands: Mapping[str, Mapping[str, FlowErrors]], name_of: Callable[[str], str]
) -> TextTable | None:
    limits = sorted({limit for errors in bands.values() for limit in errors}, key=float)
    values = {name: {x: item.epe_m for x, item in own.items()} for name, own in bands.items()}
    return _values_table(title, values, {limit: name_of(limit) for limit in limits})


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
