# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The tables of a run: columns of its summary with titles, units and decimals."""

import math
from collections.abc import Container, Iterable, Iterator, Mapping
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.evaluation.argoverse_metrics import RANGE_WISE, THREE_WAY
from mnsf_ros.evaluation.movers import LostBy
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.summary import (
    FAST,
    MOVER_GROUPS,
    SLOW,
    errors_in,
    missed_movers,
    part_of,
)
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_number


class Column(NamedTuple):
    """A column of numbers."""

    title: str  # with its unit
    decimals: int | None = 3  # None for whole numbers with commas
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
CALLED_DYNAMIC: Final = {
    "precision": _percent("precision"),
    "recall": _percent("recall"),
    "iou": _percent("IoU"),
    "ghosts_per_sweep": Column("false movers per sweep", 2),
    "ghost_sweeps": _percent("sweeps with false movers"),
}
TRACKED: Final = {
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
    "num_lost": Column("ego motion lost", None),
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
# Columns without a best value, and those whose largest value is the best.
_COUNTS: Final = {
    *(one.title for name, one in _WORK.items() if name.startswith("num_")),
    *(_OBJECTS[name].title for name in ("num_movers", "num_sweeps")),
    _CONSISTENCY["zero_nearest_m"].title,
}
_HIGHER: Final = {
    *(_ERRORS[name].title for name in ("acc5", "acc10")),
    *(CALLED_DYNAMIC[name].title for name in ("precision", "recall", "iou")),
    _OBJECTS["found"].title,
}
_MOVERS: Final = "method: movers"  # head of rows of a method and a group of movers
_GROUP_TITLES: Final = {"all": "All points", "dynamic": "Dynamic points", "static": "Static points"}


def _made_table(
    frame: pd.DataFrame, columns: Mapping[str, Column], title: str, row_title: str = "method"
) -> TextTable:
    """Returns columns of a table of numbers as text; the index has the names of the rows."""
    values = frame.reindex(columns=list(columns)).astype(float)
    rows = [
        [str(name), *map(Column.cell, columns.values(), line)]
        for name, line in zip(values.index, values.to_numpy(), strict=True)
    ]
    return TextTable([row_title, *(one.title for one in columns.values())], rows, title)


def errors_table(errors: pd.DataFrame, title: str = "", row_title: str = "method") -> TextTable:
    """Returns errors in the paper's column order, shares in percent.

    `errors` has the fields of `FlowErrors` as columns, and optionally `time_ms`.
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
        _part_table(summary, "movers", CALLED_DYNAMIC, "Points called dynamic, and false movers"),
        _part_table(summary, "movers", TRACKED, tracked),
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
    """Returns the methods with values in a part of the summary, and the columns that it has."""
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
    return _made_table(frame, _OBJECTS, "Objects that move, of 20 points and more", _MOVERS)


def best_cells(table: TextTable, references: Container[str]) -> set[tuple[int, int]]:
    """Returns rows and columns of the best values, if methods other than references differ.

    Rows of groups of movers compete within their group. Equal texts are equally good.
    """
    groups: dict[str, list[int]] = {}
    for line, (name, *_) in enumerate(table.rows):
        method, _, group = name.rpartition(": ") if table.header[0] == _MOVERS else (name, "", "")
        if method not in references:
            groups.setdefault(group, []).append(line)
    found = set()
    for column, title in enumerate(table.header):
        choose = max if title in _HIGHER else min
        for lines in groups.values() if column and title not in _COUNTS else ():
            cells = {line: table.rows[line][column] for line in lines}
            values = {
                line: float(text.replace(",", ""))
                for line, text in cells.items()
                if text != NO_VALUE
            }
            if len({*values.values()}) > 1:
                best = choose(values.values())
                found |= {(line, column) for line, value in values.items() if value == best}
    return found


def missed_tables(rows: Iterable[ResultRow], method: str) -> list[TextTable]:
    """Returns the movers that a method missed: those that *found* counts, then the others."""
    missed = missed_movers(row for row in rows if row.method == method)
    titles = {
        True: f"Movers that {method} missed in most sweeps (see also mnsf explain)",
        False: (
            "Missed, but not counted by “found”: in the first 0.3 s in view (0.6 s below "
            "2 m/s), beyond 50 m (30 m), slower than 0.5 m/s"
        ),
    }
    return [
        _missed_table(missed[missed["is_counted"] == is_counted], title)
        for is_counted, title in titles.items()
        if (missed["is_counted"] == is_counted).any()
    ]


def _missed_table(missed: pd.DataFrame, title: str) -> TextTable:
    """The movers that were missed most often, each in its sweep with most points."""
    header = ("mover", "sweeps", "stamp (s)", "x, y (m)", "speed (m/s)", "points", "lost by")
    movers = [own for _, own in missed.groupby(["recording", "object_id"])]
    cells = []
    for own in sorted(movers, key=len, reverse=True)[:_NUM_LISTED]:
        item = own.loc[own["num_points"].idxmax()]
        cells.append(
            (
                *(f"{item['recording']}: {item['kind']}", str(len(own)), f"{item['time_s']:.3f}"),
                ", ".join(f"{value:.1f}" for value in item["place_m"]),
                *(f"{item['speed_m_s']:.1f}", f"{item['num_points']:,}"),
                item["lost_by"].value if item["lost_by"] else NO_VALUE,
            )
        )
    return TextTable(header, cells, title)
