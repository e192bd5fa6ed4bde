# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Results of a run, computed once from its rows: summaries, tables, worst sweeps, notes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.summary import row_table, summary_of
from mnsf_ros.presets import UsedSettings
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
        used_settings: The settings of each method.
        summary: Summary of all recordings together, a line for each method.
        by_recording: Name of each recording to its own summary.
        protocol: Sentences on the data and the options behind the figures.
        notes: Limits of the figures.
        focus: The method whose worst sweeps are shown; empty if there is none.
    """

    record: RunRecord
    table: pd.DataFrame
    used_settings: dict[str, UsedSettings]
    summary: pd.DataFrame
    by_recording: dict[str, pd.DataFrame]
    protocol: list[str]
    notes: list[Note]
    focus: str

    @cached_property
    def main_tables(self) -> list[TextTable]:
        """Errors, movers and self-consistency."""
        return main_tables(self.summary)

    @cached_property
    def further_tables(self) -> list[TextTable]:
        """Details; the last table has the numbers of examples."""
        return further_tables(self.summary)

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
    try:
        return results_of(record, rows, folder.finished(rows).values(), focus)
    except EvaluationError as error:
        raise EvaluationError(f"{folder.path}: {error}") from error


def results_of(
    record: RunRecord,
    rows: Iterable[ResultRow],
    finished: Iterable[FinishedTask] = (),
    focus: str | None = None,
) -> RunResults:
    """Returns the results of a run, from its rows in any order and its finished tasks.

    The worst sweeps are those of the `focus`, else of the first method that is no reference, if one
    has a flow of the first of those.

    Raises:
        EvaluationError: The run has no such method.
    """
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    table, names = row_table(rows), record.method_names
    summary = summary_of(table, names)
    parts = {name: table[table["recording"] == name] for name in table["recording"].unique()}
    parts = {one.name: table[:0] for one in record.recordings} | parts
    focus = _focus(record, summary, focus)
    used = {name: record.used_settings(name) for name in dict.fromkeys([*names, *summary.index])}
    used[focus] = record.used_settings(focus)
    return RunResults(
        record=record,
        table=table,
        used_settings=used,
        summary=summary,
        by_recording={name: summary_of(part, names) for name, part in parts.items()},
        protocol=protocol_text(record, summary, used),
        notes=notes_of(record, list(finished), rows),
        focus=focus,
    )


def _focus(record: RunRecord, summary: pd.DataFrame, wanted: str | None) -> str:
    known = list(dict.fromkeys([*record.method_names, *summary.index]))
    if wanted is not None:
        if wanted not in known:
            raise EvaluationError(f"has no method {wanted!r}; it has {', '.join(known) or 'none'}")
        return wanted
    found = [name for name in summary.index if summary.at[name, "num_examples"]]
    rivals = [name for name in found if name not in record.references]
    named = [name for name in known if name not in record.references]
    return next(iter(rivals or named or found), "")
