# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Protocol of a run, and the limits of its figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.options import EvaluationOptions, num_sweeps_needed
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.presets import UsedSettings

_MAX_NAMES: Final = 4
_EVENTS: Final = {one.value: one.text for one in Event if one is not Event.SWEEPS_READ}


def protocol_text(
    run: RunRecord, table: pd.DataFrame, used: Mapping[str, UsedSettings]
) -> list[str]:
    """Returns sentences on the examples, points, settings and times of a run.

    `table` is a `summary.row_table`, `used` has the settings of each method.
    """
    methods = [name for name in used if name in set(table["method"])]
    return [
        _means_text(len(run.recordings), table, run.options.every),
        _points_text(run.options, [one.truth is not None for one in run.recordings]),
        _settings_text({name: used[name] for name in methods}, run.references),
        _time_text(run.options, table),
    ]


def _means_text(num_recordings: int, table: pd.DataFrame, every: int) -> str:
    has_flow = [row.failure is None for row in table["row"]]
    counts = sorted(pd.Series(has_flow, dtype=bool).groupby(list(table["method"])).sum().unique())
    examples = " to ".join(f"{count:,}" for count in dict.fromkeys(counts[:1] + counts[-1:]))
    recordings = "1 recording" if num_recordings == 1 else f"{num_recordings} recordings"
    noun = "example" if counts == [1] else "examples"
    text = f"Unweighted mean over {examples or 'no'} {noun} from {recordings}"
    if every > 1:
        text += f", one in {every}"
    text += ". An example is a triplet of consecutive sweeps"
    missing = has_flow.count(False)
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


def _time_text(options: EvaluationOptions, table: pd.DataFrame) -> str:
    devices = sorted({row.device for row in table["row"]} - {""})
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
    reasons = chain.from_iterable(row.stop_reasons.values() for row in table["row"])
    limited = list(reasons).count("time_budget")
    if limited:
        text += (
            f". {limited:,} optimizations reached their time budget, so errors depend on the speed "
            "of the machine"
        )
    return f"{text}."


class Note(NamedTuple):
    """A limit of the figures, in one line.

    Attributes:
        text: The line.
        is_incomplete: Whether a recording was not evaluated as a whole.
    """

    text: str
    is_incomplete: bool = False


def notes_of(
    run: RunRecord, finished: Sequence[FinishedTask], rows: Sequence[ResultRow] = ()
) -> list[Note]:
    """Returns the limits of the figures of a run, the incomplete recordings first."""
    recordings = run.recordings
    damages = chain(*(one.damages for one in recordings), *(one.damages for one in finished))
    incomplete = (
        _unfinished(run, finished, rows),
        (f"Damage: {damage}" for damage in damages),
        _without_example(run, finished),
        _without_flow(rows),
    )
    others = (
        _failures(rows),
        _without_errors(run, rows),
        _listed(
            [one.name for one in recordings if not one.has_checksums],
            "no checksums, so flipped bits inside a message would go unnoticed.",
        ),
        _listed(
            [one.name for one in recordings if one.truth is None], "no true flow, so no errors."
        ),
        (
            f"{task.recording}: {_EVENTS[name]}: {count:,}."
            for task in finished
            for name, count in task.counts.items()
            if name in _EVENTS
        ),
        _mixed_sessions(run.sessions),
    )
    # Methods notice the same in the same recording.
    return [
        *(Note(text, is_incomplete=True) for text in dict.fromkeys(chain(*incomplete))),
        *(Note(text) for text in dict.fromkeys(chain(*others))),
    ]


def _unfinished(
    run: RunRecord, finished: Sequence[FinishedTask], rows: Sequence[ResultRow]
) -> Iterator[str]:
    """Tasks that were interrupted or gave up."""
    ended = {(one.recording, one.method) for one in finished}
    count = Counter((row.recording, row.method) for row in rows)
    for recording in run.recordings:
        for method in run.method_names:
            if (recording.name, method) not in ended:
                yield (
                    f"Unfinished: {method} on {recording.name}, examples so far: "
                    f"{count[recording.name, method]:,}; continue with --resume."
                )


def _without_example(run: RunRecord, finished: Sequence[FinishedTask]) -> Iterator[str]:
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


def _without_flow(rows: Sequence[ResultRow]) -> Iterator[str]:
    """Tasks that failed on all of their examples; dropped examples do not count."""
    failed = Counter((row.method, row.recording) for row in rows if row.has_failed)
    answered = {(row.method, row.recording) for row in rows if row.failure is None}
    for (method, recording), count in failed.items():
        if (method, recording) not in answered:
            yield f"No flow: {method} failed on every example of {recording}: {count:,}."


def _failures(rows: Sequence[ResultRow]) -> Iterator[str]:
    """Number and first reason of the failures of each method."""
    failed = [row for row in rows if row.has_failed]
    count = Counter(row.method for row in failed)
    firsts = {row.method: row for row in reversed(failed)}
    for method in count:
        first = firsts[method]
        yield (
            f"{method}: examples without a flow: {count[method]:,}; the first, sweep "
            f"{first.number} of {first.recording}: {str(first.failure).removesuffix('.')}."
        )


def _without_errors(run: RunRecord, rows: Iterable[ResultRow]) -> Iterator[str]:
    """Recordings with truth for none of the scored points."""
    num_points: Counter[str] = Counter()
    for row in rows:
        if row.failure is None:
            num_points[row.recording] += row.errors["all"].num_points if row.errors else 0
    for one in run.recordings:
        if one.truth is not None and num_points.get(one.name) == 0:
            yield f"{one.name}: no scored point has valid truth, so no errors."


def _mixed_sessions(sessions: Sequence[SessionRecord]) -> Iterator[str]:
    """Differences between the sessions of a resumed run."""
    values = pd.DataFrame(
        {
            "git commits": str(session.git_commit),
            "machines": session.machine.name,
            "processors": session.machine.processor,
            "gpus": str(session.machine.gpu),
            **{f"versions of {name}": number for name, number in session.versions.items()},
        }
        for session in sessions
    )
    for name in values:
        found = values[name].dropna().unique()
        if len(found) > 1:
            yield f"Rows of {len(sessions)} sessions with different {name}: {', '.join(found)}."


def _listed(names: Sequence[str], text: str) -> Iterator[str]:
    """One note on all recordings of these names, if there are any."""
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    if names:
        yield f"{', '.join(names[:_MAX_NAMES])}{more}: {text}"
