# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Results of a run, computed once from its rows: summaries, comparisons, worst sweeps, notes."""

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
from mnsf_ros.report.run_tables import RunTables, tables_of


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
        focus: The method under test; empty if there is none.
        worst: Lines of its examples with a flow, the worst one first.
    """

    record: RunRecord
    table: pd.DataFrame
    used_settings: dict[str, UsedSettings]
    summary: pd.DataFrame
    by_recording: dict[str, pd.DataFrame]
    protocol: list[str]
    notes: list[Note]
    focus: str
    worst: pd.DataFrame

    @cached_property
    def tables(self) -> RunTables:
        """All tables of the run."""
        return tables_of(self)

    @property
    def is_incomplete(self) -> bool:
        """Whether a recording was not evaluated as a whole."""
        return any(note.is_incomplete for note in self.notes)


def read_results(folder: RunFolder, focus: str | None = None) -> RunResults:
    """Reads the results of a run so far; `focus` is the method under test, see `results_of`.

    Raises:
        EvaluationError: There is no run, or its files are damaged, or it has no such method.
    """
    record, rows = folder.read_record(), list(folder.rows)
    finished = folder.finished().values()
    try:
        return results_of(record, rows, finished, focus)
    except EvaluationError as error:
        raise EvaluationError(f"{folder.path}: {error}") from error


def results_of(
    record: RunRecord,
    rows: Iterable[ResultRow],
    finished: Iterable[FinishedTask] = (),
    focus: str | None = None,
) -> RunResults:
    """Returns the results of a run, from its rows in any order and its finished tasks.

    The method under test is the `focus`, else the first one that is no reference, if one has a flow
    the first of those.

    Raises:
        EvaluationError: The run has no such method.
    """
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    table, names = row_table(rows), record.method_names
    summary = summary_of(table, names)
    parts = {name: table[table["recording"] == name] for name in table["recording"].unique()}
    parts = {one.name: table[:0] for one in record.recordings} | parts
    focus = _method_under_test(record, summary, focus)
    used = {name: record.used_settings(name) for name in dict.fromkeys([*names, *summary.index])}
    used[focus] = record.used_settings(focus)
    return RunResults(
        record=record,
        table=table,
        used_settings=used,
        summary=summary,
        by_recording={name: summary_of(part, names) for name, part in parts.items()},
        protocol=protocol_text(record, summary, rows, used),
        notes=notes_of(record, list(finished), rows),
        focus=focus,
        worst=_worst_first(table[table["method"] == focus]),
    )


def _method_under_test(record: RunRecord, summary: pd.DataFrame, wanted: str | None) -> str:
    known = list(dict.fromkeys([*record.method_names, *summary.index]))
    if wanted is not None:
        if wanted not in known:
            raise EvaluationError(f"has no method {wanted!r}; it has {', '.join(known) or 'none'}")
        return wanted
    found = [name for name in summary.index if summary.at[name, "num_examples"]]
    rivals = [name for name in found if name not in record.references]
    named = [name for name in known if name not in record.references]
    return next(iter(rivals or named or found), "")


def _worst_first(own: pd.DataFrame) -> pd.DataFrame:
    """The lines of one method that have a flow and a figure, the worst first."""
    badness_m = [float("nan") if row.failure else row.badness_m for row in own["row"]]
    known = own.assign(badness_m=badness_m).dropna(subset="badness_m")
    return known.sort_values("badness_m", ascending=False, kind="stable")
