# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Results of a run, computed once from its rows: summaries, tables, worst sweeps, notes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.summary import row_table, summary_of
from mnsf_ros.report.notes import Note, notes_of, protocol_text
from mnsf_ros.report.tables import further_tables, main_tables
from mnsf_ros.report.text_table import TextTable


@dataclass(frozen=True)
class RunResults:
    """Results of a run.

    Attributes:
        record: What was run.
        table: A line for each example and method, by recording and sweep, see
            `summary.row_table`.
        finished: The tasks that are finished.
        focus: The method whose worst sweeps are shown; empty if there is none.
    """

    record: RunRecord
    table: pd.DataFrame
    finished: Sequence[FinishedTask]
    focus: str

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Summary of all recordings together, a line for each method."""
        return summary_of(self.table, self.record.method_names)

    @cached_property
    def by_recording(self) -> dict[str, pd.DataFrame]:
        """Name of each recording to its own summary."""
        names = [recording.name for recording in self.record.recordings]
        parts = {name: self.table[self.table["recording"] == name] for name in names}
        return {name: summary_of(part, self.record.method_names) for name, part in parts.items()}

    @cached_property
    def main_tables(self) -> list[TextTable]:
        """Errors, movers and self-consistency."""
        return main_tables(self.summary)

    @cached_property
    def further_tables(self) -> list[TextTable]:
        """Details; the last table has the numbers of examples."""
        return further_tables(self.summary)

    @property
    def protocol(self) -> list[str]:
        """Sentences on the data and the options behind the figures."""
        return protocol_text(self.record, self.summary)

    @cached_property
    def notes(self) -> list[Note]:
        """Limits of the figures."""
        return notes_of(self.record, self.finished, list(self.table["row"]))

    @property
    def worst(self) -> pd.DataFrame:
        """Lines of the `focus` that have a flow and a figure to judge it by, the worst first."""
        own = self.table[self.table["method"] == self.focus]
        badness_m = [float("nan") if row.failure else row.badness_m for row in own["row"]]
        known = own.assign(badness_m=badness_m).dropna(subset="badness_m")
        return known.sort_values("badness_m", ascending=False, kind="stable")

    @property
    def is_incomplete(self) -> bool:
        """Whether a recording was not evaluated as a whole."""
        return any(note.is_incomplete for note in self.notes)


def read_results(folder: RunFolder, focus: str | None = None) -> RunResults:
    """Reads the results of a run so far; `focus` as in `results_of`.

    Raises:
        EvaluationError: There is no run, or its files are damaged, or it has no such method.
    """
    record, rows = folder.read_record(), folder.rows()
    if focus is not None and focus not in record.method_names:
        known = ", ".join(record.method_names)
        raise EvaluationError(f"{folder.path}: has no method {focus!r}; it has {known}")
    return results_of(record, rows, folder.finished(rows).values(), focus)


def results_of(
    record: RunRecord,
    rows: Iterable[ResultRow],
    finished: Iterable[FinishedTask] = (),
    focus: str | None = None,
) -> RunResults:
    """Returns the results of a run, from its rows in any order and its finished tasks.

    The worst sweeps are those of the `focus`, else of the first method that is no reference, if one
    has a flow of the first of those.
    """
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    if focus is None:
        names = record.method_names
        rivals = [name for name in names if name not in record.references] or names
        answered = {row.method for row in rows if row.failure is None}
        focus = next((name for name in rivals if name in answered), next(iter(rivals), ""))
    return RunResults(record, row_table(rows), list(finished), focus)
