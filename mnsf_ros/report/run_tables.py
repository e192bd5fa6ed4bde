"""All tables of a run: of its methods, of these on the same sweeps, and of the worst sweeps."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mnsf_ros.evaluation.paired import PairedDifference
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import consistency_table, errors_table, further_tables, main_tables
from mnsf_ros.report.text_table import (
    NO_VALUE,
    Column,
    TextTable,
    format_number,
    format_percent,
    table_of,
)

_NUM_LISTED: Final = 10
_NANOSECONDS: Final = 1e9


class RunTables(NamedTuple):
    """The tables of a run, without those that would be empty.

    Attributes:
        main: Those that everybody wants to see, at the end that of consistency.
        comparison: What can be compared fairly: common sweeps, and differences on the same sweeps.
        further: Those for readers who look closer.
        consistency: Figures that need no truth.
        worst: The worst sweeps of the method under test.
        missed: The movers that it missed most often.
    """

    main: list[TextTable]
    comparison: list[TextTable]
    further: list[TextTable]
    consistency: TextTable | None
    worst: TextTable | None
    missed: TextTable | None


def tables_of(results: RunResults) -> RunTables:
    """Returns the tables of a run."""
    main, consistency = main_tables(results.summaries), consistency_table(results.summaries)
    comparison = (common_table(results), differences_table(results))
    return RunTables(
        main=[*main, *([] if consistency is None else [consistency])],
        comparison=[table for table in comparison if table is not None],
        further=further_tables(results.summaries),
        consistency=consistency,
        worst=worst_table(results),
        missed=missed_table(results),
    )


def common_table(results: RunResults) -> TextTable | None:
    """Returns errors on the sweeps that every method answered; None if all answered the same."""
    common = results.common
    if common is None:
        return None
    title = (
        f"The same sweeps for all methods: the {common.num_common} of {common.num_sweeps} that "
        "each of them answered. The tables above compare different sweeps"
    )
    return errors_table(common.errors, title=title)


def differences_table(results: RunResults) -> TextTable | None:
    """Returns by how much the method under test is better than each other one; None without."""
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
    return table_of(rows, columns, title, "against") if rows else None


def _interval_text(difference: PairedDifference) -> str:
    if math.isnan(difference.low_m):
        return format_number(math.nan, 3)
    return f"{_signed(difference.low_m)} to {_signed(difference.high_m)}"


def _signed(value_m: float) -> str:
    """The value with a sign, but no minus where all digits are zero."""
    return f"{round(value_m, 3) + 0.0:+.3f}"


def worst_table(results: RunResults) -> TextTable | None:
    """Returns the figures of the worst sweeps; None if none can be judged."""
    worst = results.worst
    if not worst:
        return None
    has_truth = any(row.errors for row in worst)
    header = ["sweep", "points"]
    header += ["EPE (m)", "Acc5 (%)", "dynamic EPE (m)"] if has_truth else []
    header += ["to next sweep (m)", "time (ms)"]
    listed = [_cells(row, has_truth) for row in worst[:_NUM_LISTED]]
    title = f"The worst {len(listed)} of {len(worst)} sweeps of {results.focus}"
    return TextTable(header, listed, title)


def _cells(row: ResultRow, has_truth: bool) -> list[str]:
    cells = [f"{row.recording}, sweep {row.number}", f"{row.num_points:,}"]
    if has_truth:
        errors, dynamic = row.errors.get("all"), row.errors.get("dynamic")
        cells += [
            "-" if errors is None else format_number(errors.epe_m, 3),
            "-" if errors is None else format_percent(errors.acc5),
            "-" if dynamic is None else format_number(dynamic.epe_m, 3),
        ]
    nearest_m = row.consistency.get("nearest_m", math.nan)
    return [*cells, format_number(nearest_m, 3), format_number(row.time_ms, 0)]


def missed_table(results: RunResults) -> TextTable | None:
    """Returns the movers that were missed most often; None if none were."""
    header = ["mover", "sweeps", "stamp (s)", "x, y (m)", "speed (m/s)", "points", "lost by"]
    listed = [
        [
            f"{one.row.recording}: {one.item.kind}",
            str(one.num_sweeps),
            f"{one.row.stamp_ns / _NANOSECONDS:.3f}",
            ", ".join(f"{value:.1f}" for value in one.item.place_m),
            f"{one.item.speed_m_s:.1f}",
            f"{one.item.num_points:,}",
            NO_VALUE if one.item.lost_by is None else one.item.lost_by.value,
        ]
        for one in results.missed[:_NUM_LISTED]
    ]
    title = (
        f"Movers that {results.focus} missed in most sweeps (mnsf explain tells more of a place)"
    )
    return TextTable(header, listed, title) if listed else None
