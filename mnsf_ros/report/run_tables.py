# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All tables of a run: of its methods, of these on the same sweeps, and of the worst sweeps."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mnsf_ros.drawing.charts import time_text
from mnsf_ros.evaluation.metrics import NO_ERRORS, FlowErrors
from mnsf_ros.evaluation.paired import PairedDifference
from mnsf_ros.evaluation.results import MethodSummary, ResultRow
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import (
    ERRORS,
    consistency_table,
    further_tables,
    main_tables,
    work_table,
)
from mnsf_ros.report.text_table import (
    NO_VALUE,
    Column,
    Table,
    TextTable,
    format_number,
    format_percent,
    made_tables,
)
from mnsf_ros.sweeps.sweep import NANOSECONDS

_NUM_LISTED: Final = 10


class RunTables(NamedTuple):
    """The tables of a run, without those that say nothing.

    Attributes:
        main: Those that everybody wants to see.
        consistency: Figures that need no truth, at most one table.
        comparison: What can be compared fairly: common sweeps, and differences on the same sweeps.
        further: Those for readers who look closer.
        work: How many examples there were, and what became of them; it is in `further`, too.
        worst: The worst sweeps of the method under test, at most one table.
        missed: The movers that it missed most often, likewise.
    """

    main: list[TextTable]
    consistency: list[TextTable]
    comparison: list[TextTable]
    further: list[TextTable]
    work: list[TextTable]
    worst: list[TextTable]
    missed: list[TextTable]

    @property
    def listed(self) -> list[TextTable]:
        """Those of all methods, in the order of files."""
        return [*self.main, *self.consistency, *self.comparison, *self.further]


def tables_of(results: RunResults) -> RunTables:
    """Returns the tables of a run."""
    summaries = results.summaries
    tables = (
        main_tables(summaries),
        [consistency_table(summaries)],
        [*common_tables(results), differences_table(results)],
        further_tables(summaries),
        [work_table(summaries)],
        [worst_table(results)],
        [missed_table(results)],
    )
    return RunTables(*(made_tables(one) for one in tables))


def common_tables(results: RunResults) -> list[Table]:
    """Returns errors on the sweeps that every method answered, if not all answered the same."""
    common = results.common
    if common is None:
        return []
    title = (
        f"The same sweeps for all methods: the {common.num_common} of {common.num_sweeps} that "
        "each of them answered. The tables above compare different sweeps"
    )
    return [Table(title, list(common.errors.items()), ERRORS, says_enough=True)]


def differences_table(results: RunResults) -> Table:
    """Returns by how much the method under test is better than each other one."""
    focus = results.focus
    columns = (
        Column("sweeps", lambda one: str(one.num_sweeps)),
        Column(f"{focus} (m)", lambda one: format_number(one.under_test_m, 3)),
        Column("other (m)", lambda one: format_number(one.other_m, 3)),
        Column("difference (m)", lambda one: _signed(one.mean_m)),
        Column("95 % interval (m)", _interval_text),
        Column(f"{focus} is", lambda one: one.verdict),
    )
    title = (
        f"{focus} against the others, on the sweeps that both answered: EPE of the other minus "
        f"that of {focus} (paired; bootstrap over blocks of consecutive sweeps)"
    )
    rows = [(f"{method}, {group}", one) for (method, group), one in results.differences.items()]
    return Table(title, rows, columns, "against")


def _interval_text(difference: PairedDifference) -> str:
    if math.isnan(difference.low_m):
        return NO_VALUE
    return f"{_signed(difference.low_m)} to {_signed(difference.high_m)}"


def _signed(value_m: float) -> str:
    """The value with a sign, but no minus where all digits are zero."""
    return f"{round(value_m, 3) + 0.0:+.3f}"


def _errors(row: ResultRow, group: str) -> FlowErrors:
    return row.errors.get(group, NO_ERRORS)


_POINTS: Final = Column("points", lambda row: f"{row.num_points:,}")
_WORST_ERRORS: Final = (
    Column("EPE (m)", lambda row: format_number(_errors(row, "all").epe_m, 3)),
    Column("Acc5 (%)", lambda row: format_percent(_errors(row, "all").acc5)),
    Column("dynamic EPE (m)", lambda row: format_number(_errors(row, "dynamic").epe_m, 3)),
)
_NEAREST: Final = Column(
    "to next sweep (m)", lambda row: format_number(row.consistency.get("nearest_m", math.nan), 3)
)
_TIME: Final = Column("time (ms)", lambda row: format_number(row.time_ms, 0))


def worst_table(results: RunResults) -> Table:
    """Returns the figures of the worst sweeps."""
    listed = results.worst[:_NUM_LISTED]
    has_truth = any(row.errors for row in results.worst)
    columns = (_POINTS, *(_WORST_ERRORS if has_truth else ()), _NEAREST, _TIME)
    title = f"The worst {len(listed)} of {len(results.worst)} sweeps of {results.focus}"
    rows = [(f"{row.recording}, sweep {row.number}", row) for row in listed]
    return Table(title, rows, columns, "sweep")


_MISSED: Final = (
    Column("sweeps", lambda one: str(one.num_sweeps)),
    Column("stamp (s)", lambda one: f"{one.row.stamp_ns / NANOSECONDS:.3f}"),
    Column("x, y (m)", lambda one: ", ".join(f"{value:.1f}" for value in one.item.place_m)),
    Column("speed (m/s)", lambda one: f"{one.item.speed_m_s:.1f}"),
    Column("points", lambda one: f"{one.item.num_points:,}"),
    Column("lost by", lambda one: one.lost_by),
)


def missed_table(results: RunResults) -> Table:
    """Returns the movers that were missed most often."""
    listed = results.missed[:_NUM_LISTED]
    rows = [(f"{one.row.recording}: {one.item.kind}", one) for one in listed]
    title = (
        f"Movers that {results.focus} missed in most sweeps (mnsf explain tells more of a place)"
    )
    return Table(title, rows, _MISSED, "mover")


def tiles_of(results: RunResults) -> list[tuple[str, str]]:
    """Returns what the method under test achieved in a few large figures, each with what it is."""
    own = (one for one in results.summaries if one.method == results.focus)
    return [tile for summary in own for tile in _tiles(summary)]


def _tiles(summary: MethodSummary) -> list[tuple[str, str]]:
    figures = []
    errors, dynamic = summary.errors.get("all"), summary.errors.get("dynamic")
    if errors is not None and errors.num_points > 0:
        figures += [
            (f"{errors.epe_m:.3f} m", "mean end point error"),
            (f"{format_percent(errors.acc5)} %", "points within 5 cm or 5 %"),
        ]
        if dynamic is not None and dynamic.num_points > 0:
            figures.append((f"{dynamic.epe_m:.3f} m", "error of dynamic points"))
    elif summary.consistency:
        for key, text in (
            ("nearest_m", "moved points to the next sweep"),
            ("zero_nearest_m", "the same without any flow"),
            ("cycle_m", "forward-backward disagreement"),
        ):
            value = summary.consistency.get(key, math.nan)
            if not math.isnan(value):
                figures.append((f"{value:.3f} m", text))
    figures.append((time_text(summary.time_ms), "run time per sweep"))
    if not math.isnan(summary.latency_ms):
        figures.append((time_text(summary.latency_ms), "from sweep to flow"))
    figures.append((f"{summary.num_examples:,}", "flows"))
    if summary.num_dropped or summary.num_failed:
        figures.append((f"{summary.num_dropped} / {summary.num_failed}", "dropped / failed"))
    return figures
