# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The tables of a run: columns of its summary with titles, units and decimals."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.evaluation.argoverse_metrics import RANGE_WISE, THREE_WAY
from mnsf_ros.evaluation.movers import LostBy, ObjectRow
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.summary import FAST, MOVER_GROUPS, SLOW, errors_in, part_of
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_number
from mnsf_ros.sweeps.sweep import NANOSECONDS


class Column(NamedTuple):
    """A column of numbers."""

    title: str  # with its unit
    decimals: int | None = 3  # behind the point; None for whole numbers with commas
    factor: float = 1.0  # from values to the unit, 100 for shares in percent

    def cell(self, value: float) -> str:
        """Returns the text of a value, a dash for NaN."""
        if self.decimals is None and not math.isnan(value):
            return f"{value:,.0f}"
        return format_number(value * self.factor, self.decimals or 0)


def _percent(title: str) -> Column:
    return Column(f"{title} (%)", 1, 100.0)


_NUM_LISTED: Final = 10
_TIME: Final = Column("time (ms)", 0)
# The paper's column order.
_ERRORS: Final = {
    "epe_m": Column("EPE (m)", 3),
    "acc5": _percent("Acc5"),
    "acc10": _percent("Acc10"),
    "outliers": _percent("Outliers"),
    "angle_error_rad": Column("angle (rad)", 3),
}
_CALLED_DYNAMIC: Final = {
    "precision": _percent("precision"),
    "recall": _percent("recall"),
    "iou": _percent("IoU"),
    "ghosts_per_sweep": Column("false movers per sweep", 2),
    "ghost_sweeps": _percent("sweeps with one"),
}
_TRACKED: Final = {
    "velocity_error_m_s": Column("velocity error (m/s)", 2),
    "direction_error_deg": Column("direction error (deg)", 1),
    "after_stop_s": Column("after a stop (s)", 1),
}
_OBJECTS: Final = {
    "found": _percent("found"),
    "flicker": _percent("flicker"),
    "delay_s": Column("delay (s)", 2),
    "num_movers": Column("number", None),
    "num_sweeps": Column("mover-sweeps", None),
}
_WORK: Final = {
    "num_examples": Column("flows", None),
    "num_failed": Column("failed", None),
    "num_dropped": Column("dropped", None),
    "time_ms": _TIME,
    "latency_ms": Column("latency (ms)", 0),
    "num_warm": Column("warm starts", None),
    "num_out_of_time": Column("out of time", None),
}
_CONSISTENCY: Final = {
    "nearest_m": Column("nearest point, moved (m)"),
    "zero_nearest_m": Column("nearest point, unmoved (m)"),
}
_THREE_WAY: Final = {name: Column(name, 4) for name in (*THREE_WAY, "mean")}
_RANGE_WISE: Final = {name: Column(name, 3) for name in RANGE_WISE}
_LOST: Final = {one.value: Column(one.value, None) for one in LostBy}
_GROUP_TITLES: Final = {"all": "All points", "dynamic": "Dynamic points", "static": "Static points"}


def _made_table(
    frame: pd.DataFrame, columns: Mapping[str, Column], title: str, row_title: str = "method"
) -> TextTable:
    """Returns columns of a table of numbers as text; its index names the rows."""
    values = frame.reindex(columns=list(columns)).astype(float)
    rows = [
        [str(name), *map(Column.cell, columns.values(), line)]
        for name, line in zip(values.index, values.to_numpy(), strict=True)
    ]
    return TextTable([row_title, *(one.title for one in columns.values())], rows, title)


def errors_table(errors: pd.DataFrame, title: str = "", row_title: str = "method") -> TextTable:
    """Returns errors in the paper's column order, shares in percent.

    `errors` has the fields of `FlowErrors` as columns, and `time_ms` where the wall time of an
    estimate is to be shown.
    """
    columns = _ERRORS | ({"time_ms": _TIME} if "time_ms" in errors else {})
    return _made_table(errors, columns, title, row_title)


def main_tables(summary: pd.DataFrame) -> list[TextTable]:
    """Returns errors, movers and self-consistency of each method, as far as there are values."""
    tracked = "Tracked objects (median; after a stop: longest time)"
    consistency = (
        "Self-consistency (needs no truth; a small distance does not prove that a flow is right, a "
        "large one shows that it is wrong)"
    )
    tables = [
        *_group_tables(summary),
        _part_table(summary, "movers", _CALLED_DYNAMIC, "Points called dynamic, and false movers"),
        _part_table(summary, "movers", _TRACKED, tracked),
        _objects_table(summary, (FAST, SLOW)),
        _part_table(summary, "consistency", _CONSISTENCY, consistency),
    ]
    return [table for table in tables if table.has_values]


def further_tables(summary: pd.DataFrame) -> list[TextTable]:
    """Returns the details; the last table has the numbers of examples."""
    classes = {name: name.replace(".", " ") for name in part_of(summary, "bucketed")}
    # The mean over the classes comes last.
    classes = dict(sorted(classes.items(), key=lambda item: item[0].startswith("mean.")))
    bucketed = {name: Column(title, 3) for name, title in classes.items()}
    bucketed_title = (
        "Bucket-normalized error of Argoverse 2 within 35 m, over all points of all examples: "
        "dynamic (1: ego motion only) and static (m)"
    )
    three_way = "Three-way EPE (m) of Argoverse 2, over all points of all examples"
    range_wise = "EPE (m in 0.1 s) by range (m), dynamic from 1.4 m/s, over all points"
    lost = "Mover-sweeps without detection, by the stage that rejected the mover (to 50 m)"
    work = "Examples (out of time: optimizations ended by their time budget)"
    tables = [
        _part_table(summary, "three_way", _THREE_WAY, three_way),
        _part_table(summary, "bucketed", bucketed, bucketed_title),
        _part_table(summary, "range_wise", _RANGE_WISE, range_wise),
        _objects_table(summary, list(MOVER_GROUPS)[2:]),
        _part_table(summary, "movers.lost", _LOST, lost),
        _made_table(summary, _WORK, work),
    ]
    return [table for table in tables if table.has_values]


def _part_table(
    summary: pd.DataFrame, prefix: str, columns: Mapping[str, Column], title: str
) -> TextTable:
    """The methods with values in a part of the summary, in the columns that it has."""
    part = part_of(summary, prefix).dropna(how="all")
    return _made_table(part, {name: one for name, one in columns.items() if name in part}, title)


def _group_tables(summary: pd.DataFrame) -> Iterator[TextTable]:
    for group, words in _GROUP_TITLES.items():
        errors = errors_in(summary, group)
        counts = [f"{count:,.0f}" for count in sorted(set(errors.get("num_points", ())))]
        if any(count != "0" for count in counts):
            points = " to ".join(dict.fromkeys([counts[0], counts[-1]]))
            times = summary[["time_ms"] if group == "all" else []]
            yield errors_table(errors.join(times), f"{words} ({points} points)")


def _objects_table(summary: pd.DataFrame, groups: Iterable[str]) -> TextTable:
    parts = {group: part_of(summary, f"movers.{group}") for group in groups}
    lines = {
        f"{method}: {name}": part.loc[method]
        for method in summary.index
        for name, part in parts.items()
        if part.loc[method].notna().any()
    }
    frame = pd.DataFrame.from_dict(lines, orient="index")
    return _made_table(
        frame, _OBJECTS, "Objects that move, of 20 points and more", "method: movers"
    )


def missed_table(rows: Iterable[ResultRow], method: str) -> TextTable:
    """Returns the movers that a method missed most often, each in its sweep with most points."""
    missed: dict[tuple[str, int], list[tuple[ResultRow, ObjectRow]]] = {}
    for row in rows:
        for item in row.movers.objects if row.movers and row.method == method else ():
            if item.moves and not item.is_found:
                missed.setdefault((row.recording, item.object_id), []).append((row, item))
    header = ("mover", "sweeps", "stamp (s)", "x, y (m)", "speed (m/s)", "points", "lost by")
    cells = []
    for sweeps in sorted(missed.values(), key=len, reverse=True)[:_NUM_LISTED]:
        row, item = max(sweeps, key=lambda one: one[1].num_points)
        place = ", ".join(f"{value:.1f}" for value in item.place_m)
        cells.append(
            (
                *(f"{row.recording}: {item.kind}", str(len(sweeps))),
                *(f"{row.stamp_ns / NANOSECONDS:.3f}", place, f"{item.speed_m_s:.1f}"),
                *(f"{item.num_points:,}", item.lost_by.value if item.lost_by else NO_VALUE),
            )
        )
    title = f"Movers that {method} missed in most sweeps (see also mnsf explain)"
    return TextTable(header, cells, title)
