# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What to know beside the figures of a run: how they were made, and what casts doubt on them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain, product
from typing import Final

from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.options import EvaluationOptions, num_sweeps_needed
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import FinishedTask, MethodSummary, ResultRow
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.presets import UsedSettings

_MAX_NAMES: Final = 4
_EVENTS: Final = {event.value: event.text for event in Event}
_NO_EVENTS: Final = (Event.SWEEPS_READ.value, Event.SWEEPS_READ.text)


def protocol_text(
    run: RunRecord, summaries: Sequence[MethodSummary], used: Mapping[str, UsedSettings]
) -> list[str]:
    """Returns sentences on what was evaluated and how; `used` has the settings of each method."""
    options = run.options
    return [
        _means_text(len(run.recordings), summaries, options.every),
        _points_text(options, [one.truth is not None for one in run.recordings]),
        _settings_text({one.method: used[one.method] for one in summaries}, run.references),
        _time_text(options, summaries),
    ]


def _means_text(num_recordings: int, summaries: Sequence[MethodSummary], every: int) -> str:
    counts = sorted({summary.num_examples for summary in summaries})
    examples = " to ".join(f"{count:,}" for count in dict.fromkeys(counts[:1] + counts[-1:]))
    recordings = "1 recording" if num_recordings == 1 else f"{num_recordings} recordings"
    noun = "example" if counts == [1] else "examples"
    text = f"Unweighted mean over {examples or 'no'} {noun} from {recordings}"
    if every > 1:
        text += f", one in {every}"
    text += ". An example is a triplet of consecutive sweeps"
    missing = sum(summary.num_failed + summary.num_dropped for summary in summaries)
    if missing:
        text += f". Examples without a flow, not in any mean: {missing:,}"
    if len(counts) > 1:
        text += ". Methods differ in the number of examples: compare with care"
    return f"{text}."


def _points_text(options: EvaluationOptions, has_truth: Sequence[bool]) -> str:
    crop = options.settings.crop
    text = (
        f"Scored points: range {crop.min_range_m:g} to {crop.max_range_m:g} m, "
        f"height {crop.min_height_m:g} to {crop.max_height_m:g} m"
    )
    if options.settings.ground.remove:
        source = "height map"
        if options.ground == "truth" and any(has_truth):
            source = "flag in the truth"
            if not all(has_truth):
                source += ", height map where there is no truth"
        text += f", without ground ({source})"
    number = options.num_points
    chosen = "all" if number is None else f"{number:,} random points of each sweep"
    return f"{text}; {chosen}, the same for all methods. Seed {options.seed}."


def _settings_text(used: Mapping[str, UsedSettings], references: Collection[str]) -> str:
    """The preset of each method; references have none, unless there is nothing else."""
    methods: dict[str, list[str]] = {}
    for name in [name for name in used if name not in references] or used:
        settings, start, changed = used[name]
        changes = ", ".join(f"{key} = {value}" for key, value in changed.items())
        warm = "on" if settings.warm_start.enabled else "off"
        text = f"preset {start}{f' with {changes}' if changes else ''}, warm start {warm}"
        methods.setdefault(text, []).append(name)
    return "Settings: " + "; ".join(f"{', '.join(m)}: {text}" for text, m in methods.items()) + "."


def _time_text(options: EvaluationOptions, summaries: Sequence[MethodSummary]) -> str:
    devices = sorted({device for summary in summaries for device in summary.devices})
    threads = options.settings.compute.num_threads
    text = "Time: wall time of one estimate without the choice of points, device synchronized"
    if devices:
        text += f", on {' and '.join(devices)}"
    if "cpu" in devices:
        text += f" with {threads} thread{'' if threads == 1 else 's'}"
    if options.realtime_rate is not None:
        text += (
            f". Replay at {options.realtime_rate:g} times real time, simulated from measured run "
            "times: a triplet still waiting when the next one arrives is dropped, as in the live "
            "node"
        )
    limited = sum(summary.stop_reasons.get("time_budget", 0) for summary in summaries)
    if limited:
        text += (
            f". {limited:,} optimizations reached their time budget, so errors depend on the speed "
            "of the machine"
        )
    return f"{text}."


class NoteKind(Enum):
    """What a note is about."""

    UNFINISHED = "unfinished"
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
        return self in (
            NoteKind.UNFINISHED,
            NoteKind.DAMAGE,
            NoteKind.NO_EXAMPLE,
            NoteKind.NO_FLOW,
        )


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


def unfinished_notes(
    run: RunRecord, finished: Iterable[FinishedTask], rows: Iterable[ResultRow]
) -> list[Note]:
    """Returns one note for each method that has not seen all of a recording.

    The run was interrupted, or gave up.
    """
    ended = {(one.recording, one.method) for one in finished}
    count = Counter((row.recording, row.method) for row in rows)
    return [
        Note(
            NoteKind.UNFINISHED,
            f"Unfinished: {method} on {recording}, examples so far: {count[recording, method]:,}; "
            "--resume goes on.",
        )
        for recording, method in product((one.name for one in run.recordings), run.method_names)
        if (recording, method) not in ended
    ]


def notes_of(
    run: RunRecord, finished: Iterable[FinishedTask], rows: Iterable[ResultRow] = ()
) -> list[Note]:
    """Returns one note for each thing to know."""
    finished, rows, recordings = list(finished), list(rows), run.recordings
    found = [*(one.damages for one in recordings), *(one.damages for one in finished)]
    unchecked = [one.name for one in recordings if not one.has_checksums]
    without_truth = [one.name for one in recordings if one.truth is None]
    notes = {
        NoteKind.DAMAGE: (f"Damage: {damage}" for damage in chain.from_iterable(found)),
        NoteKind.NO_EXAMPLE: _without_example(run, finished),
        NoteKind.NO_FLOW: _without_flow(rows),
        NoteKind.FAILURES: _failures(rows),
        NoteKind.NO_ERRORS: _without_errors(recordings, rows),
        NoteKind.NO_CHECKSUMS: _listed(
            unchecked, "no checksums, so flipped bits inside a message would go unnoticed."
        ),
        NoteKind.NO_TRUTH: _listed(without_truth, "no true flow, so no errors."),
        NoteKind.EVENT: (
            # Runs of early versions have texts in place of names.
            f"{task.recording}: {_EVENTS.get(name, name)}: {count:,}."
            for task in finished
            for name, count in task.counts.items()
            if name not in _NO_EVENTS
        ),
        NoteKind.MIXED_SESSIONS: _mixed_sessions(run.sessions),
    }
    return [Note(kind, text) for kind, texts in notes.items() for text in dict.fromkeys(texts)]


def _without_example(run: RunRecord, finished: Iterable[FinishedTask]) -> Iterator[str]:
    num_sweeps = {one.name: one.num_sweeps for one in run.recordings}
    for task in finished:
        if task.num_examples == 0:
            there = num_sweeps[task.recording]
            needed = num_sweeps_needed(run.options, there)
            yield (
                f"No example: {task.recording} contains no {needed} consecutive sweeps with at "
                f"most buffer.max_interval_s between them (sweeps in all: {there:,}). --pairs "
                "uses two."
            )


def _without_errors(
    recordings: Iterable[EvaluatedRecording], rows: Iterable[ResultRow]
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


def _listed(names: Sequence[str], text: str) -> list[str]:
    """One note on all recordings of these names, if there are any."""
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return [f"{', '.join(names[:_MAX_NAMES])}{more}: {text}"] if names else []
