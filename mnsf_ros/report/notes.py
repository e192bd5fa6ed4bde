# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Protocol of a run, and the limits of its figures."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain, product
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.evaluation.options import EvaluationOptions, num_sweeps_needed
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_record import RunRecord, Session
from mnsf_ros.presets import UsedSettings

_MAX_NAMES: Final = 4
_NUMBER: Final = re.compile(r"\d+(\.\d+)?")


def protocol_text(
    run: RunRecord,
    summary: pd.DataFrame,
    rows: Sequence[ResultRow],
    used: Mapping[str, UsedSettings],
) -> list[str]:
    """Returns sentences on the examples, points, settings and times of a run.

    `used` has the settings of each method.
    """
    own = {name: used[name] for name in used if name in summary.index}
    return [
        _means_text(len(run.recordings), summary, run.options.every),
        _points_text(run.options, [one.truth is not None for one in run.recordings]),
        _settings_text(own, run.references),
        _time_text(run.options, summary, sorted({row.device for row in rows} - {""})),
    ]


def _means_text(num_recordings: int, summary: pd.DataFrame, every: int) -> str:
    counts = [f"{count:,}" for count in sorted(set(summary.get("num_examples", ())))]
    examples = " to ".join(dict.fromkeys(counts[:1] + counts[-1:])) or "no"
    recordings = "1 recording" if num_recordings == 1 else f"{num_recordings} recordings"
    text = f"Unweighted mean over {examples} {'example' if examples == '1' else 'examples'}"
    text += f" from {recordings}{f', one in {every}' if every > 1 else ''}"
    text += ". An example is a triplet of consecutive sweeps"
    missing = int(summary.reindex(columns=["num_failed", "num_dropped"]).sum().sum())
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
            source += (
                "; methods with networks are given these points, online and neural find ground"
            )
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


def _time_text(options: EvaluationOptions, summary: pd.DataFrame, devices: Sequence[str]) -> str:
    threads = options.settings.compute.num_threads
    text = "Time: stages of one estimate, device synchronized"
    if devices:
        text += f", on {' and '.join(devices)}"
    if "cpu" in devices:
        text += f" with {threads} thread{'' if threads == 1 else 's'}"
    if options.realtime_rate is not None:
        text += (
            f". Replay at {options.realtime_rate:g} times real time, simulated from measured run "
            "times: triplets that wait too long are dropped for newer ones, as in the live node"
        )
    limited = int(sum(summary.get("num_out_of_time", ())))
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
    damages = chain(*(one.damages for one in run.recordings), *(one.damages for one in finished))
    found = [
        *_unfinished(run, finished, rows),
        *(Note(f"Damage: {damage}", is_incomplete=True) for damage in damages),
        *_without_example(run, finished),
        *_failures(rows),
        *_recordings_without(run, rows),
        *(
            Note(f"{task.recording}: {event}: {count:,}.")
            for task in finished
            for event, count in task.counts.items()
        ),
        *_mixed_sessions(run.sessions),
    ]
    # Methods notice the same in the same recording.
    return sorted(dict.fromkeys(found), key=lambda note: not note.is_incomplete)


def _unfinished(
    run: RunRecord, finished: Sequence[FinishedTask], rows: Sequence[ResultRow]
) -> Iterator[Note]:
    """Tasks that were interrupted or gave up."""
    ended = {(one.recording, one.method) for one in finished}
    count = Counter((row.recording, row.method) for row in rows)
    for key in product([one.name for one in run.recordings], run.method_names):
        if key not in ended:
            recording, method = key
            text = f"{method} on {recording}, examples so far: {count[key]:,}"
            yield Note(f"Unfinished: {text}; continue with --resume.", is_incomplete=True)


def _without_example(run: RunRecord, finished: Sequence[FinishedTask]) -> Iterator[Note]:
    num_sweeps = {one.name: one.num_sweeps for one in run.recordings}
    for task in finished:
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
    """Failures of each method, those whose reasons differ in numbers alone together.

    Dropped examples do not count. A recording is incomplete if all of its examples failed.
    """
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


def _recordings_without(run: RunRecord, rows: Iterable[ResultRow]) -> Iterator[Note]:
    """Recordings without checksums, without truth, and with truth for no scored point."""
    good = [row for row in rows if row.failure is None]
    scored = {row.recording for row in good if row.errors and row.errors["all"].num_points}
    unscored = {row.recording for row in good} - scored
    blind = {one.name for one in run.recordings if one.truth is None}
    lacks = {
        "no checksums, so flipped bits inside a message would go unnoticed": {
            one.name for one in run.recordings if not one.has_checksums
        },
        "no true flow, so no errors": blind,
        "no scored point has valid truth, so no errors": unscored - blind,
    }
    for text, lacking in lacks.items():
        names = [one.name for one in run.recordings if one.name in lacking]
        if names:
            yield Note(f"{_listed(names)}: {text}.")


def _mixed_sessions(sessions: Sequence[Session]) -> Iterator[Note]:
    """Differences between the sessions of a resumed run."""
    for name in (one for one in sessions[0] if one not in ("started", "command", "system")):
        texts = dict.fromkeys(session.get(name, "") for session in sessions)
        if len(texts) > 1:
            found = "; ".join(texts)
            yield Note(f"Rows of {len(sessions)} sessions with different {name}: {found}.")


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return f"{', '.join(names[:_MAX_NAMES])}{more}"
