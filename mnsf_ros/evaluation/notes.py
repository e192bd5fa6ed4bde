"""What makes the figures of a run less certain, or explains a gap in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain
from typing import Final

from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.options import num_sweeps_needed
from mnsf_ros.evaluation.result_row import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import RecordingRecord, RunRecord, SessionRecord

_MAX_NAMES: Final = 4
_EVENTS: Final = frozenset(event.value for event in Event)


class NoteKind(Enum):
    """What a note is about."""

    DAMAGE = "damage"
    NO_EXAMPLE = "no example"
    NO_FLOW = "no flow"
    FAILURES = "failures"
    NO_ERRORS = "no errors"
    NO_CHECKSUMS = "no checksums"
    NO_TRUTH = "no truth"
    EVENT = "event"
    MIXED_SESSIONS = "mixed sessions"

    @property
    def is_incomplete(self) -> bool:
        """Whether a recording was not evaluated as a whole."""
        return self in (NoteKind.DAMAGE, NoteKind.NO_EXAMPLE, NoteKind.NO_FLOW)


@dataclass(frozen=True)
class Note:
    """One thing to know about a run.

    Attributes:
        kind: What it is about.
        text: One line for people.
    """

    kind: NoteKind
    text: str

    def __str__(self) -> str:
        """Returns the text."""
        return self.text


def notes_of(
    run: RunRecord, finished: Iterable[FinishedTask], rows: Iterable[ResultRow] = ()
) -> list[Note]:
    """Returns one note for each thing to know.

    Args:
        run: What was run.
        finished: What was noticed in each finished task.
        rows: What came out; methods that gave no flow say why.
    """
    finished, rows = list(finished), list(rows)
    notes = {
        NoteKind.DAMAGE: _damages(run, finished),
        NoteKind.NO_EXAMPLE: _without_example(run, finished),
        NoteKind.NO_FLOW: _without_flow(rows),
        NoteKind.FAILURES: _failures(rows),
        NoteKind.NO_ERRORS: _without_errors(run.recordings, rows),
        NoteKind.NO_CHECKSUMS: _without_checksums(run.recordings),
        NoteKind.NO_TRUTH: _without_truth(run.recordings),
        NoteKind.EVENT: _events(finished),
        NoteKind.MIXED_SESSIONS: _mixed_sessions(run.sessions),
    }
    return [Note(kind, text) for kind, texts in notes.items() for text in dict.fromkeys(texts)]


def _damages(run: RunRecord, finished: Iterable[FinishedTask]) -> Iterator[str]:
    found = [*(one.damages for one in run.recordings), *(one.damages for one in finished)]
    for damage in chain.from_iterable(found):
        yield f"Damage: {damage}"


def _without_checksums(recordings: Iterable[RecordingRecord]) -> Iterator[str]:
    names = [one.name for one in recordings if not one.has_checksums]
    if names:
        yield (
            f"{_listed(names)}: no checksums, so flipped bits inside a message would go unnoticed."
        )


def _without_truth(recordings: Iterable[RecordingRecord]) -> Iterator[str]:
    names = [one.name for one in recordings if one.truth is None]
    if names:
        yield f"{_listed(names)}: no true flow, so no errors."


def _events(finished: Iterable[FinishedTask]) -> Iterator[str]:
    for task in finished:
        for name, count in task.counts.items():
            # Runs of early versions have texts in place of names.
            text = Event(name).text if name in _EVENTS else name
            if text != Event.SWEEPS_READ.text:
                yield f"{task.recording}: {text}: {count:,}."


def _without_example(run: RunRecord, finished: Iterable[FinishedTask]) -> Iterator[str]:
    num_sweeps = {one.name: one.num_sweeps for one in run.recordings}
    for task in finished:
        if task.num_examples == 0:
            there = num_sweeps[task.recording]
            needed = num_sweeps_needed(run.identity.num_sweeps, there)
            yield (
                f"No example: {task.recording} contains no {needed} consecutive sweeps with at "
                f"most buffer.max_interval_s between them (sweeps in all: {there:,}). --pairs "
                "uses two."
            )


def _without_errors(
    recordings: Iterable[RecordingRecord], rows: Iterable[ResultRow]
) -> Iterator[str]:
    """Recordings whose truth says nothing of any point that was scored."""
    num_points: Counter[str] = Counter()
    for row in rows:
        if row.failure is None:
            num_points[row.recording] += row.errors["all"].num_points if row.errors else 0
    for one in recordings:
        if one.truth is not None and num_points.get(one.name) == 0:
            yield f"{one.name}: no scored point has valid truth, so no errors."


def _without_flow(rows: Iterable[ResultRow]) -> Iterator[str]:
    """Tasks that failed on all of their examples; dropped examples do not count."""
    failed: Counter[tuple[str, str]] = Counter()
    answered: set[tuple[str, str]] = set()
    for row in rows:
        if row.failure is None:
            answered.add((row.method, row.recording))
        elif row.has_failed:
            failed[row.method, row.recording] += 1
    for (method, recording), count in failed.items():
        if (method, recording) not in answered:
            yield f"No flow: {method} failed on every example of {recording}: {count:,}."


def _mixed_sessions(sessions: Sequence[SessionRecord]) -> Iterator[str]:
    """What differs between the sessions of a run that was resumed."""
    told: dict[str, dict[str, None]] = {}
    for session in sessions:
        values = {
            "git commits": str(session.git_commit),
            "machines": session.machine.name,
            "processors": session.machine.processor,
            "gpus": str(session.machine.gpu),
            **{f"versions of {name}": number for name, number in session.versions.items()},
        }
        for what, value in values.items():
            told.setdefault(what, {})[value] = None
    for what, found in told.items():
        if len(found) > 1:
            yield f"Rows of {len(sessions)} sessions with different {what}: {', '.join(found)}."


def _failures(rows: Iterable[ResultRow]) -> Iterator[str]:
    """For each method that gave no flow somewhere, how often and why at first."""
    failed: dict[str, list[ResultRow]] = {}
    for row in rows:
        if row.has_failed:
            failed.setdefault(row.method, []).append(row)
    for method, (first, *more) in failed.items():
        text = str(first.failure)
        end = "" if text.endswith((".", "?")) else "."
        yield (
            f"{method}: examples without a flow: {len(more) + 1:,}; the first, sweep "
            f"{first.number} of {first.recording}: {text}{end}"
        )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return ", ".join(names[:_MAX_NAMES]) + more
