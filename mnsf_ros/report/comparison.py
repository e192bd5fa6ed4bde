"""The method under test against the others, on the same sweeps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from mnsf_ros.evaluation.paired import (
    PairedDifference,
    common_sweeps,
    errors_of,
    paired_difference,
)
from mnsf_ros.evaluation.results import ResultRow, summarize
from mnsf_ros.report.closer_look import closer_look
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import errors_table
from mnsf_ros.report.text_table import Column, TextTable, format_number, table_of

_GROUPS: Final = ("all", "dynamic", "static")


def comparison_tables(results: RunResults) -> list[TextTable]:
    """Returns what can be compared fairly: common sweeps, and differences on the same sweeps."""
    tables = (common_table(results), differences_table(results))
    return [table for table in tables if table is not None]


def differences_table(results: RunResults) -> TextTable | None:
    """Returns by how much the method under test is better than each other one; None without."""
    focus = closer_look(results).method
    rows = [
        (f"{summary.method}, {group}", difference)
        for summary in results.summaries
        if summary.method != focus
        for group in _GROUPS
        if (difference := _difference(results.rows, focus, summary.method, group)) is not None
    ]
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
    return table_of(rows, columns, title, "against") if rows else None


def _difference(
    rows: Sequence[ResultRow], focus: str, other: str, group: str
) -> PairedDifference | None:
    return paired_difference(errors_of(rows, focus, group), errors_of(rows, other, group))


def _interval_text(difference: PairedDifference) -> str:
    if math.isnan(difference.low_m):
        return format_number(math.nan, 3)
    return f"{_signed(difference.low_m)} to {_signed(difference.high_m)}"


def _signed(value_m: float) -> str:
    """The value with a sign, but no minus where all digits are zero."""
    return f"{round(value_m, 3) + 0.0:+.3f}"


def common_table(results: RunResults) -> TextTable | None:
    """Returns errors on the sweeps that every method answered; None if all answered the same."""
    methods = [summary.method for summary in results.summaries if summary.num_examples]
    common = common_sweeps(results.rows, methods)
    sweeps = {(row.recording, row.number) for row in results.rows}
    if all(one.num_examples == len(common) for one in results.summaries if one.num_examples):
        return None
    rows = [row for row in results.rows if (row.recording, row.number) in common]
    errors = {one.method: one.errors["all"] for one in summarize(rows, methods) if one.errors}
    title = (
        f"The same sweeps for all methods: the {len(common)} of {len(sweeps)} that each of them "
        "answered. The tables above compare different sweeps"
    )
    return errors_table(errors, title=title) if errors or not common else None
