"""All that a run gave, put together from its folder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from mnsf_ros.evaluation.results import FinishedTask, MethodSummary, ResultRow, summarize
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.report.notes import Note, notes_of, protocol_text


@dataclass(frozen=True)
class RunResults:
    """All that a run gave.

    Attributes:
        record: What was run.
        rows: One for each example and method, by recording and sweep.
        summaries: One for each method.
        protocol: Sentences on what the figures are figures of.
        notes: What makes them less certain.
    """

    record: RunRecord
    rows: list[ResultRow]
    summaries: list[MethodSummary]
    protocol: list[str]
    notes: list[Note]

    @property
    def is_incomplete(self) -> bool:
        """Whether a recording was not evaluated as a whole."""
        return any(note.kind.is_incomplete for note in self.notes)

    @cached_property
    def by_recording(self) -> dict[str, list[MethodSummary]]:
        """Name of each recording to the summaries of the methods on it alone."""
        rows_of: dict[str, list[ResultRow]] = {one.name: [] for one in self.record.recordings}
        for row in self.rows:
            rows_of.setdefault(row.recording, []).append(row)
        order = self.record.method_names
        return {name: summarize(rows, order) for name, rows in rows_of.items()}


def read_results(folder: RunFolder) -> RunResults:
    """Reads what a run has given so far.

    Raises:
        EvaluationError: There is no run, or its files are damaged.
    """
    return results_of(folder.read_record(), folder.rows, folder.finished().values())


def results_of(
    record: RunRecord, rows: Iterable[ResultRow], finished: Iterable[FinishedTask] = ()
) -> RunResults:
    """Returns what a run gave, from its rows in any order and what its tasks noticed."""
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    summaries = summarize(rows, record.method_names)
    protocol = protocol_text(record, summaries)
    return RunResults(record, rows, summaries, protocol, notes_of(record, finished, rows))
