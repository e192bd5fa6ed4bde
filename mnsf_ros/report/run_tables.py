# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All tables of a run: its methods, their comparison, the worst sweeps and missed movers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import pandas as pd

from mnsf_ros.drawing.charts import time_text
from mnsf_ros.evaluation.comparison import common_sweeps, differences, verdict
from mnsf_ros.evaluation.movers import ObjectRow
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.summary import errors_in
from mnsf_ros.report.tables import (
    TIME,
    Column,
    errors_table,
    further_tables,
    made_table,
    main_tables,
)
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_number, format_percent
from mnsf_ros.sweeps.sweep import NANOSECONDS

if TYPE_CHECKING:
    from mnsf_ros.report.run_results import RunResults

_NUM_LISTED: Final = 10
_WORST: Final = {
    "num_points": Column("points", None),
    "errors.all.epe_m": Column("EPE (m)"),
    "errors.all.acc5": Column("Acc5 (%)", 1, factor=100.0),
    "errors.dynamic.epe_m": Column("dynamic EPE (m)"),
    "consistency.nearest_m": Column("to next sweep (m)"),
    "time_ms": TIME._replace(better=None),
}


class RunTables(NamedTuple):
    """The tables of a run that have values.

    Attributes:
        main: Errors, movers and self-consistency.
        comparison: Common sweeps, and differences on the same sweeps.
        further: Details; the last one has the numbers of examples.
        worst: The worst sweeps of the method under test, at most one table.
        missed: The movers that it missed most often, at most one table.
    """

    main: list[TextTable]
    comparison: list[TextTable]
    further: list[TextTable]
    worst: list[TextTable]
    missed: list[TextTable]

    @property
    def listed(self) -> list[TextTable]:
        """Those of all methods, in the order of files."""
        return [*self.main, *self.comparison, *self.further]

    @property
    def printed(self) -> list[TextTable]:
        """Those for the terminal."""
        return [*self.main, *self.comparison, *self.further[-1:]]


def tables_of(results: RunResults) -> RunTables:
    """Returns the tables of a run."""
    tables = (
        main_tables(results.summary),
        [differences_table(results)],
        further_tables(results.summary),
        [worst_table(results)],
        [missed_table(results)],
    )
    main, comparison, *others = ([one for one in part if one.has_values] for part in tables)
    return RunTables(main, [*common_tables(results), *comparison], *others)


def common_tables(results: RunResults) -> list[TextTable]:
    """Returns errors on the sweeps that every method answered, if not all answered the same."""
    found = common_sweeps(results.table)
    if found is None:
        return []
    num_common, summary = found
    errors = errors_in(summary, "all")
    if num_common and errors.empty:
        return []
    num_sweeps = len(results.table.drop_duplicates(["recording", "number"]))
    title = (
        f"The same sweeps for all methods: the {num_common} of {num_sweeps} that each of them "
        "answered. The tables above compare different sweeps"
    )
    order = [method for method in results.summary.index if method in errors.index]
    return [errors_table(errors.loc[order], title)]


def differences_table(results: RunResults) -> TextTable:
    """Returns by how much the method under test is better than each other one."""
    focus = results.focus
    found = differences(results.table, focus, results.summary.index)
    header = (
        "against",
        "sweeps",
        f"{focus} (m)",
        "other (m)",
        "difference (m)",
        "95 % interval (m)",
        f"{focus} is",
    )
    rows = [
        (
            f"{method}, {group}",
            f"{one['num_sweeps']:.0f}",
            format_number(one["under_test_m"], 3),
            format_number(one["other_m"], 3),
            _signed(one["mean_m"]),
            _interval_text(one),
            verdict(one),
        )
        for (method, group), one in found.iterrows()
    ]
    title = (
        f"{focus} against the others, on the sweeps that both answered: EPE of the other minus "
        f"that of {focus} (paired; Student's interval of the means of consecutive sweeps)"
    )
    return TextTable(header, rows, title)


def _interval_text(difference: pd.Series) -> str:
    if math.isnan(difference["low_m"]):
        return NO_VALUE
    return f"{_signed(difference['low_m'])} to {_signed(difference['high_m'])}"


def _signed(value_m: float) -> str:
    """The value with a sign, but no minus where all digits are zero."""
    return f"{round(value_m, 3) + 0.0:+.3f}"


def worst_table(results: RunResults) -> TextTable:
    """Returns the figures of the worst sweeps."""
    listed = results.worst[:_NUM_LISTED]
    names = [f"{row.recording}, sweep {row.number}" for row in listed["row"]]
    columns = {name: one for name, one in _WORST.items() if name in results.worst}
    title = f"The worst {len(listed)} of {len(results.worst)} sweeps of {results.focus}"
    return made_table(listed.set_axis(names), columns, title, "sweep")


def missed_table(results: RunResults) -> TextTable:
    """Returns the movers that were missed most often, each in its sweep with most points."""
    missed: dict[tuple[str, int], list[tuple[ResultRow, ObjectRow]]] = {}
    for row in results.table["row"]:
        for item in row.missed_movers if row.method == results.focus else ():
            missed.setdefault((row.recording, item.object_id), []).append((row, item))
    header = ("mover", "sweeps", "stamp (s)", "x, y (m)", "speed (m/s)", "points", "lost by")
    rows = []
    for sweeps in sorted(missed.values(), key=len, reverse=True)[:_NUM_LISTED]:
        row, item = max(sweeps, key=lambda one: one[1].num_points)
        cells = (
            f"{row.recording}: {item.kind}",
            str(len(sweeps)),
            f"{row.stamp_ns / NANOSECONDS:.3f}",
            ", ".join(f"{value:.1f}" for value in item.place_m),
            f"{item.speed_m_s:.1f}",
            f"{item.num_points:,}",
            NO_VALUE if item.lost_by is None else item.lost_by.value,
        )
        rows.append(cells)
    title = f"Movers that {results.focus} missed in most sweeps (see also mnsf explain)"
    return TextTable(header, rows, title)


# Columns of the summary in metres, and their meaning.
_TRUE_ERRORS: Final = {
    "errors.all.epe_m": "mean end point error",
    "errors.dynamic.epe_m": "error of dynamic points",
}
_DISTANCES: Final = {
    "consistency.nearest_m": "moved points to the next sweep",
    "consistency.zero_nearest_m": "the same without any flow",
}


def tiles_of(results: RunResults) -> list[tuple[str, str]]:
    """Returns a few large figures of the method under test, each with its meaning."""
    if results.focus not in results.summary.index:
        return []
    own = results.summary.loc[results.focus].dropna()
    figures = _TRUE_ERRORS if "errors.all.epe_m" in own else _DISTANCES
    tiles = [(f"{own[name]:.3f} m", text) for name, text in figures.items() if name in own]
    if "errors.all.acc5" in own:
        tiles.append((f"{format_percent(own['errors.all.acc5'])} %", "points within 5 cm or 5 %"))
    times = {"time_ms": "run time per sweep", "latency_ms": "from sweep to flow"}
    tiles += [(time_text(own[name]), text) for name, text in times.items() if name in own]
    counts = (own[f"num_{name}"] for name in ("examples", "dropped", "failed"))
    num_examples, num_dropped, num_failed = map(int, counts)
    tiles.append((f"{num_examples:,}", "flows"))
    if num_dropped or num_failed:
        tiles.append((f"{num_dropped} / {num_failed}", "dropped / failed"))
    return tiles
