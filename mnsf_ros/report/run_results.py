# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Results of a run, computed once from its rows: summaries, tables, worst sweeps, notes."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import num_sweeps_needed
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.summary import row_table, summary_of
from mnsf_ros.report.tables import further_tables, main_tables
from mnsf_ros.report.text_table import TextTable

_MAX_NAMES: Final = 4
_NUMBER: Final = re.compile(r"\d+(\.\d+)?")


class Note(NamedTuple):
    """A limit of the figures, in one line."""

    text: str
    is_incomplete: bool = False  # a recording was not evaluated as a whole


@dataclass(frozen=True)
class RunResults:
    """Results of a run."""

    record: RunRecord
    table: pd.DataFrame  # by recording and sweep, see `summary.row_table`
    focus: str  # method whose worst sweeps are shown; may be empty

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Summary of all recordings, a line for each method."""
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
        """Sentences on the data and the options of the figures."""
        return _protocol_text(self.record, self.summary)

    @cached_property
    def notes(self) -> list[Note]:
        """Limits of the figures."""
        return _notes_of(self.record, list(self.table["row"]))

    @property
    def worst(self) -> pd.DataFrame:
        """Lines of the `focus` with a flow and a known badness, the worst first."""
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
    record, rows = folder.read()
    if focus is not None and focus not in record.method_names:
        known = ", ".join(record.method_names)
        raise EvaluationError(f"{folder.path}: has no method {focus!r}; it has {known}")
    return results_of(record, rows, focus)


def results_of(
    record: RunRecord, rows: Iterable[ResultRow], focus: str | None = None
) -> RunResults:
    """Returns the results of a run, from its rows in any order.

    The `focus` is by default the first method that has a flow and is not a reference.
    """
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    if focus is None:
        names = record.method_names
        rivals = [name for name in names if name not in record.references] or names
        answered = {row.method for row in rows if row.failure is None}
        focus = next((name for name in rivals if name in answered), next(iter(rivals), ""))
    return RunResults(record, row_table(rows), focus)


def _protocol_text(run: RunRecord, summary: pd.DataFrame) -> list[str]:
    """Returns sentences on the examples, points, settings and times of a run."""
    options, crop = run.options, run.options.settings.crop
    counts = sorted(set(summary.get("num_examples", ())))
    numbers = " to ".join(f"{count:,}" for count in dict.fromkeys([*counts[:1], *counts[-1:]]))
    examples = f"{numbers or 'no'} example{'' if numbers == '1' else 's'}"
    recordings = "1 recording" if len(run.recordings) == 1 else f"{len(run.recordings)} recordings"
    every = f", one in {options.every}" if options.every > 1 else ""
    points = f"{options.num_points:,} random points" if options.num_points else "all points"
    ground = "ground included"
    if options.settings.ground.remove:
        by_truth = options.ground == "truth" and any(one.truth for one in run.recordings)
        ground = f"ground left out by {'the truth' if by_truth else 'the settings'}"
    replay = (
        f". Replay at {options.realtime:g} times real time, simulated from measured run times; "
        "sweeps are dropped as in the live node"
    )
    return [
        f"Unweighted mean over {examples} from {recordings}{every}.",
        f"Scored: {points} within {crop.min_range_m:g} to {crop.max_range_m:g} m, {ground}; "
        f"seed {options.seed}.",
        _settings_text(run, [str(name) for name in summary.index]),
        "Time: stages of one estimate, device synchronized; threads: "
        f"{options.settings.compute.num_threads}{replay if options.realtime else ''}.",
    ]


def _settings_text(run: RunRecord, names: Sequence[str]) -> str:
    """The preset of each method; references have none, unless there is nothing else."""
    methods: dict[str, list[str]] = {}
    for name in [name for name in names if name not in run.references] or names:
        settings, start, changed = run.used_settings(name)
        changes = ", ".join(f"{key} = {value}" for key, value in changed.items())
        warm = "on" if settings.warm_start.enabled else "off"
        text = f"preset {start}{f' with {changes}' if changes else ''}, warm start {warm}"
        methods.setdefault(text, []).append(name)
    return "Settings: " + "; ".join(f"{', '.join(m)}: {text}" for text, m in methods.items()) + "."


def _notes_of(run: RunRecord, rows: Sequence[ResultRow]) -> list[Note]:
    """Returns the limits of the figures of a run, the incomplete recordings first."""
    damages = chain(
        *(one.damages for one in run.recordings), *(one.damages for one in run.finished)
    )
    found = [
        *_unfinished(run, rows),
        *(Note(f"Damage: {damage}", is_incomplete=True) for damage in damages),
        *_without_example(run),
        *_failures(rows),
        *_losses(rows),
        *_recordings_without(run, rows),
        *_findings(run),
        *(
            Note(f"{task.recording}: {event}: {count:,}.")
            for task in run.finished
            for event, count in task.counts.items()
        ),
    ]
    # Methods notice the same in the same recording.
    return sorted(dict.fromkeys(found), key=lambda note: not note.is_incomplete)


def _unfinished(run: RunRecord, rows: Sequence[ResultRow]) -> Iterator[Note]:
    ended = {one.key for one in run.finished}
    count = Counter(row.task for row in rows)
    for key in product([one.name for one in run.recordings], run.method_names):
        if key not in ended:
            recording, method = key
            text = f"{method} on {recording}, examples so far: {count[key]:,}"
            yield Note(f"Unfinished: {text}; continue with --resume.", is_incomplete=True)


def _without_example(run: RunRecord) -> Iterator[Note]:
    num_sweeps = {one.name: one.num_sweeps for one in run.recordings}
    for task in run.finished:
        if task.num_examples == 0:
            there = num_sweeps[task.recording]
            needed = num_sweeps_needed(run.options, there)
            yield Note(
                f"No example: {task.recording} contains no {needed} consecutive sweeps with at "
                f"most buffer.max_interval_s between them (sweeps in all: {there:,}). --pairs "
                "uses two.",
                is_incomplete=True,
            )


def _failures(rows: Sequence[ResultRow]) -> Iterator[Note]:
    """Yields a note for each method and kind of failure: reasons that differ in numbers alone."""
    answered = {(row.method, row.recording) for row in rows if row.failure is None}
    kinds: dict[tuple[str, str], list[ResultRow]] = {}
    for row in rows:
        if row.has_failed:
            kinds.setdefault((row.method, _NUMBER.sub("#", row.failure or "")), []).append(row)
    for (method, _), failed in kinds.items():
        first, reason = failed[0], (failed[0].failure or "").removesuffix(".")
        text = (
            f"{method}: examples without a flow: {len(failed):,}; the first, sweep "
            f"{first.number} of {first.recording}: {reason}."
        )
        names = dict.fromkeys(row.recording for row in failed)
        lost = [name for name in names if (method, name) not in answered]
        yield Note(f"{text} No flow at all: {_listed(lost)}." if lost else text, bool(lost))


def _losses(rows: Sequence[ResultRow]) -> Iterator[Note]:
    """Yields a note for each method and recording whose ego motion was lost."""
    tasks: dict[tuple[str, str], list[ResultRow]] = {}
    for row in rows:
        if row.failure is None:
            tasks.setdefault(row.task, []).append(row)
    for (recording, method), own in tasks.items():
        if lost := [row for row in own if row.lost]:
            reasons = Counter(row.lost for row in lost).most_common()
            yield Note(
                f"{method}: ego motion lost in {len(lost):,} of {len(own):,} sweeps of "
                f"{recording}, first in sweep {lost[0].number}: "
                f"{', '.join(f'{reason} ({count:,})' for reason, count in reasons)}."
            )


def _findings(run: RunRecord) -> Iterator[Note]:
    """Yields violated assumptions, once for each recording: all methods notice about the same."""
    found: dict[tuple[str, str], str] = {}
    for task in run.finished:
        for assumption, text in task.findings.items():
            found.setdefault((task.recording, assumption), text)
    for (recording, _), text in found.items():
        yield Note(f"Input of {recording}: {text}.")


def _recordings_without(run: RunRecord, rows: Sequence[ResultRow]) -> Iterator[Note]:
    """Yields the recordings without truth, and those with truth for no scored point."""
    good = [row for row in rows if row.failure is None]
    scored = {row.recording for row in good if row.errors and row.errors["all"].num_points}
    unscored = {row.recording for row in good} - scored
    blind = {one.name for one in run.recordings if one.truth is None}
    lacks = {
        "no true flow, so no errors": blind,
        "no scored point has valid truth, so no errors": unscored - blind,
    }
    for text, lacking in lacks.items():
        names = [one.name for one in run.recordings if one.name in lacking]
        if names:
            yield Note(f"{_listed(names)}: {text}.")


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return f"{', '.join(names[:_MAX_NAMES])}{more}"
