"""The tables of a run, in the paper's order of columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from mnsf_ros.evaluation.argoverse_metrics import DYNAMIC, STATIC, THREE_WAY
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.evaluation.tables import TextTable, errors_table, format_number

_GROUP_TITLES = {
    "all": "All points",
    "dynamic": "Points that move by themselves",
    "static": "Points that stand still",
}


def main_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables that everybody wants to see, without those that would be empty."""
    consistency = consistency_table(summaries)
    return [*group_tables(summaries), *([] if consistency is None else [consistency])]


def group_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the errors of all, dynamic and static points, without tables that would be empty."""
    tables = [_group_table(summaries, group) for group in _GROUP_TITLES]
    return [table for table in tables if table is not None]


def further_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables for those who look closer, without those that would be empty."""
    ranges = _bands_table(
        "EPE (m) by range: up to so many metres from the sensor",
        {summary.method: summary.by_range for summary in summaries},
        "m",
    )
    speeds = _bands_table(
        "EPE (m) by true speed without the sensor's own motion: up to so many m/s",
        {summary.method: summary.by_speed for summary in summaries},
        "m/s",
    )
    tables = [_three_way_table(summaries), _bucketed_table(summaries), ranges, speeds]
    return [table for table in [*tables, work_table(summaries)] if table is not None]


def consistency_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns the figures that need no truth; None if there are none."""
    if not any(summary.consistency for summary in summaries):
        return None
    columns = {
        "nearest_m": "moved points to next sweep (m)",
        "zero_nearest_m": "unmoved (m)",
        "cycle_m": "there and back (m)",
    }
    if all(math.isnan(summary.consistency.get("cycle_m", math.nan)) for summary in summaries):
        # Nobody has asked for it.
        del columns["cycle_m"]
    rows = [
        [
            summary.method,
            *(format_number(summary.consistency.get(key, math.nan), 3) for key in columns),
        ]
        for summary in summaries
    ]
    return TextTable(["method", *columns.values()], rows, "Self-consistency, which needs no truth")


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
    title = "Examples; out of time: optimizations that a budget ended"
    return TextTable(header, rows, title, better)


def _group_table(summaries: Sequence[MethodSummary], group: str) -> TextTable | None:
    errors = {s.method: s.errors[group] for s in summaries if group in s.errors}
    num_scored = {name: item.num_points for name, item in errors.items()}
    if not any(num_scored.values()):
        return None
    least, most = min(num_scored.values()), max(num_scored.values())
    points = f"{most:,} points" if least == most else f"{least:,} to {most:,} points"
    title = f"{_GROUP_TITLES[group]} ({points})"
    if group != "all":
        return errors_table(errors, title=title)
    times_ms = {summary.method: summary.time_ms for summary in summaries}
    return errors_table(errors, title=title, times_ms=times_ms)


def _three_way_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    scored = [summary for summary in summaries if summary.three_way_epe_m]
    if not scored:
        return None
    names = (*THREE_WAY, "mean")
    rows = [
        [s.method, *(format_number(s.three_way_epe_m[name], 4) for name in names)] for s in scored
    ]
    title = "Three-way EPE (m) of Argoverse 2, over all points of all examples"
    return TextTable(["method", *names], rows, title, [None, *[min] * len(names)])


def _bucketed_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    classes = _in_order(summary.bucketed for summary in summaries)
    if not classes:
        return None
    columns = [(name, kind) for name in classes for kind in (DYNAMIC, STATIC)]
    header = ["method", *(f"{name} {kind}" for name, kind in columns)]
    rows = []
    for summary in summaries:
        values = [summary.bucketed.get(name, {}).get(kind, math.nan) for name, kind in columns]
        rows.append([summary.method, *(format_number(value, 3) for value in values)])
    title = (
        "Bucket-normalized error of Argoverse 2 within 35 m, over all points of all examples: "
        "dynamic (1: nothing but the sensor's own motion) and static (m)"
    )
    return TextTable(header, rows, title, [None, *[min] * len(columns)])


def _bands_table(
    title: str, bands: Mapping[str, Mapping[str, FlowErrors]], unit: str
) -> TextTable | None:
    limits = sorted(_in_order(bands.values()), key=float)
    if not limits:
        return None
    header = ["method", *("farther" if x == "inf" else f"{x} {unit}" for x in limits)]
    if unit == "m/s":
        header = [column.replace("farther", "faster") for column in header]
    rows = [
        [method, *(format_number(errors[x].epe_m if x in errors else math.nan, 3) for x in limits)]
        for method, errors in bands.items()
    ]
    return TextTable(header, rows, title, [None, *[min] * len(limits)])


def _in_order(parts: Iterable[Mapping[str, object]]) -> list[str]:
    """All keys, in the order in which they come first; `mean` last."""
    names = list(dict.fromkeys(name for part in parts for name in part))
    return sorted(names, key=lambda name: name == "mean")
