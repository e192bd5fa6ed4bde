# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All that a run gave, computed once from its rows: summaries, comparisons, worst sweeps, notes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.metrics import mean
from mnsf_ros.evaluation.movers import ObjectRow
from mnsf_ros.evaluation.paired import (
    CommonSweeps,
    PairedDifference,
    SweepKey,
    common_sweeps,
    differences,
    errors_of,
)
from mnsf_ros.evaluation.results import (
    FinishedTask,
    MethodSummary,
    ResultRow,
    summarize,
    summarize_each,
)
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.presets import UsedSettings
from mnsf_ros.report.notes import Note, notes_of, protocol_text, unfinished_notes
from mnsf_ros.report.text_table import NO_VALUE

_NUMBER: Final = re.compile(r"\d+(\.\d+)?")
_REST: Final = "other"
# A smaller part of the time outside of all stages is not worth a colour.
_REST_SHARE: Final = 0.02


class MissedMover(NamedTuple):
    """A mover that was missed, in the sweep in which there was most to be seen of it."""

    row: ResultRow
    item: ObjectRow
    num_sweeps: int

    @property
    def lost_by(self) -> str:
        """What lost it, as text; a dash if the method does not say."""
        return NO_VALUE if self.item.lost_by is None else self.item.lost_by.value


class Failures(NamedTuple):
    """How often a method gave no flow for a reason; those that differ in numbers alone are one."""

    method: str
    number: int
    text: str


@dataclass(frozen=True)
class SweepFigures:
    """What is known of a method sweep by sweep, or point by point.

    Attributes:
        errors_m: The end point error of each sweep that has one.
        error_shares: Share of all points in each bin up to `metrics.ERROR_LIMITS_M`; empty if
            nobody knows.
        stage_times_ms: Stage to mean time; what is in no stage is `other`. Empty if not timed.
    """

    errors_m: dict[SweepKey, float]
    error_shares: list[float]
    stage_times_ms: dict[str, float]


@dataclass(frozen=True)
class RunResults:
    """All that a run gave.

    Attributes:
        record: What was run.
        rows: One for each example and method, by recording and sweep.
        used_settings: The settings of each method.
        summaries: One for each method.
        by_recording: Name of each recording to the summaries of the methods on it alone.
        sweeps: Figures of each method that has a summary.
        protocol: Sentences on what the figures are figures of.
        notes: What makes them less certain.
        focus: The method under test; empty if there is none.
        worst: Its rows that have a flow, the worst one first.
        missed: The movers that it did not find in some sweep, the one of most sweeps first.
        common: Errors on common sweeps; None if all methods answered the same ones,
            or without truth.
        differences: Other method and group of points to its difference from the one under test.
        failures: Why sweeps have no flow, the most frequent reason first.
    """

    record: RunRecord
    rows: list[ResultRow]
    used_settings: dict[str, UsedSettings]
    summaries: list[MethodSummary]
    by_recording: dict[str, list[MethodSummary]]
    sweeps: dict[str, SweepFigures]
    protocol: list[str]
    notes: list[Note]
    focus: str
    worst: list[ResultRow]
    missed: list[MissedMover]
    common: CommonSweeps | None
    differences: dict[tuple[str, str], PairedDifference]
    failures: list[Failures]

    @property
    def is_incomplete(self) -> bool:
        """Whether a recording was not evaluated as a whole."""
        return any(note.kind.is_incomplete for note in self.notes)


def read_results(folder: RunFolder, focus: str | None = None) -> RunResults:
    """Reads what a run has given so far; `focus` is the method to look at, see `results_of`.

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
    """Returns what a run gave, from its rows in any order and what its tasks noticed.

    The method under test is the `focus`, else the first one named that is no reference, if one has
    a flow the first of those.

    Raises:
        EvaluationError: The run has no such method.
    """
    finished = list(finished)
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    summaries = summarize(rows, record.method_names)
    names = (one.name for one in record.recordings)
    by_recording = summarize_each(rows, names, record.method_names)
    known = list(dict.fromkeys([*record.method_names, *(one.method for one in summaries)]))
    focus = _method_under_test(record, known, summaries, focus)
    used = {method: record.used_settings(method) for method in (*known, focus)}
    own = [row for row in rows if row.method == focus]
    errors_m = {one.method: errors_of(rows, one.method, "all") for one in summaries}
    return RunResults(
        record=record,
        rows=rows,
        used_settings=used,
        summaries=summaries,
        by_recording=by_recording,
        protocol=protocol_text(record, summaries, used),
        notes=[*unfinished_notes(record, finished, rows), *notes_of(record, finished, rows)],
        common=common_sweeps(rows, summaries),
        differences=differences(rows, focus, [one.method for one in summaries]),
        focus=focus,
        sweeps={name: _sweep_figures(rows, name, errors) for name, errors in errors_m.items()},
        worst=_worst_first(own),
        missed=_missed_movers(own),
        failures=_failures(rows),
    )


def _method_under_test(
    record: RunRecord,
    known: Sequence[str],
    summaries: Sequence[MethodSummary],
    wanted: str | None,
) -> str:
    if wanted is not None:
        if wanted not in known:
            raise EvaluationError(f"has no method {wanted!r}; it has {', '.join(known) or 'none'}")
        return wanted
    found = [summary.method for summary in summaries if summary.num_examples]
    rivals = [name for name in found if name not in record.references]
    named = [name for name in known if name not in record.references]
    return next(iter(rivals or named or found), "")


def _worst_first(rows: Iterable[ResultRow]) -> list[ResultRow]:
    known = [row for row in rows if row.failure is None and not math.isnan(row.badness_m)]
    return sorted(known, key=lambda row: (-row.badness_m, row.recording, row.number))


def _missed_movers(rows: Iterable[ResultRow]) -> list[MissedMover]:
    missed: dict[tuple[str, int], list[tuple[ResultRow, ObjectRow]]] = {}
    for row in rows:
        for item in row.missed_movers:
            missed.setdefault((row.recording, item.object_id), []).append((row, item))
    most = (
        MissedMover(*max(sweeps, key=lambda one: (one[1].num_points, -one[0].number)), len(sweeps))
        for sweeps in missed.values()
    )
    return sorted(most, key=lambda one: -one.num_sweeps)


def _failures(rows: Iterable[ResultRow]) -> list[Failures]:
    texts: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.failure is not None:
            text = row.failure.text
            texts.setdefault((row.method, _NUMBER.sub("#", text)), []).append(text)
    found = [
        Failures(method, len(own), own[0] if len(set(own)) == 1 else f"the first one: {own[0]}")
        for (method, _), own in texts.items()
    ]
    return sorted(found, key=lambda one: -one.number)


def _sweep_figures(
    rows: Sequence[ResultRow], method: str, errors_m: dict[SweepKey, float]
) -> SweepFigures:
    own = [row for row in rows if row.method == method]
    counts = [row.error_counts for row in own if row.error_counts]
    totals = np.sum(counts, axis=0) if counts else np.zeros(0)
    shares: list[float] = (totals / max(1, totals.sum())).tolist()
    return SweepFigures(errors_m, shares, _stage_times_ms(own))


def _stage_times_ms(rows: Iterable[ResultRow]) -> dict[str, float]:
    own = [row for row in rows if row.failure is None]
    whole = mean([row.time_ms for row in own])
    if math.isnan(whole):
        return {}
    stages = dict.fromkeys(name for row in own for name in row.stage_times_ms)
    parts = {name: mean([row.stage_times_ms.get(name, 0.0) for row in own]) for name in stages}
    rest = whole - math.fsum(parts.values())
    return parts | ({_REST: rest} if rest > _REST_SHARE * whole else {})
