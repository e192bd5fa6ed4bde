"""What makes the figures of a run less certain, or explains a gap in them, line by line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.options import num_sweeps_needed, registers
from mnsf_ros.evaluation.result_row import DROPPED, ResultRow

# What notes begin with that tell of a recording which was not evaluated as a whole.
DAMAGE = "Damage: "
NO_EXAMPLE = "No example: "
NO_FLOW = "No flow: "
_EVENTS = frozenset(event.value for event in Event)
# Runs of earlier versions have texts in place of names.
_NO_NEWS = (Event.SWEEPS_READ.value, Event.SWEEPS_READ.text)


def notes_text(
    run: Mapping[str, Any], finished: Iterable[Mapping[str, Any]], rows: Iterable[ResultRow] = ()
) -> list[str]:
    """Returns one line for each thing to know.

    Args:
        run: The record of the run.
        finished: What was noticed in each finished task, see `tasks.jsonl`.
        rows: What came out; methods that gave no flow say why.
    """
    recordings, finished, rows = run["recordings"], list(finished), list(rows)
    lines = chain(
        _damages([*recordings, *finished]),
        _without_example(run, finished),
        _without_flow(rows),
        _failures(rows),
        _without_errors(recordings, rows),
        _without_checksums(recordings),
        _without_truth(recordings),
        _without_ground(run),
        _events(finished),
        _mixed_sessions(run.get("sessions", ())),
    )
    return list(dict.fromkeys(lines))


def _damages(records: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    for record in records:
        for damage in record["damages"]:
            yield f"{DAMAGE}{damage}"


def _without_checksums(recordings: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    names = [one["name"] for one in recordings if not one["has_checksums"]]
    if names:
        yield (
            f"{_listed(names)}: {_has(names)} no checksums, so that flipped bits within a message "
            "would have gone unnoticed."
        )


def _without_truth(recordings: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    names = [one["name"] for one in recordings if one["truth"] is None]
    if names:
        yield f"{_listed(names)}: {_has(names)} no truth, so there are no errors."


def _without_ground(run: Mapping[str, Any]) -> Iterator[str]:
    """Methods that lose more by the removal of the ground than the others."""
    identity = run["identity"]
    is_removed = identity["crop_and_ground"]["ground.remove"]
    names = [method for method in run["methods"] if registers(method)]
    if names and is_removed and identity["realtime_rate"] is None:
        yield (
            f"{_listed(names)}: got sweeps without ground, as all methods did, and found the "
            "sensor's motion less exactly than the live node; --realtime 1 gives whole sweeps."
        )


def _events(finished: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    for task in finished:
        for name, count in task["counts"].items():
            if name not in _NO_NEWS:
                text = Event(name).text if name in _EVENTS else name
                yield f"{task['recording']}: {text}: {count:,}."


def _without_example(
    run: Mapping[str, Any], finished: Iterable[Mapping[str, Any]]
) -> Iterator[str]:
    num_sweeps = {one["name"]: one["num_sweeps"] for one in run["recordings"]}
    for task in finished:
        if task.get("num_examples") == 0:
            name = task["recording"]
            needed = num_sweeps_needed(run["identity"]["num_sweeps"], num_sweeps[name])
            yield (
                f"{NO_EXAMPLE}{name} has nowhere {needed} sweeps in a row with no more than "
                f"buffer.max_interval_s between them (sweeps in all: {num_sweeps[name]:,}); "
                "--pairs makes do with two."
            )


def _without_errors(
    recordings: Iterable[Mapping[str, Any]], rows: Iterable[ResultRow]
) -> Iterator[str]:
    """Recordings whose truth says nothing of any point that was scored."""
    num_points: Counter[str] = Counter()
    for row in rows:
        if not row.failure:
            num_points[row.recording] += row.errors["all"].num_points if row.errors else 0
    for one in recordings:
        if one["truth"] is not None and num_points.get(one["name"]) == 0:
            yield (
                f"{one['name']}: no point that was scored has a valid truth, so there are no "
                "errors."
            )


def _without_flow(rows: Iterable[ResultRow]) -> Iterator[str]:
    """Tasks that failed on all of their examples; that one was dropped says nothing."""
    failed: Counter[tuple[str, str]] = Counter()
    answered: set[tuple[str, str]] = set()
    for row in rows:
        if not row.failure:
            answered.add((row.method, row.recording))
        elif row.failure != DROPPED:
            failed[row.method, row.recording] += 1
    for (method, recording), count in failed.items():
        if (method, recording) not in answered:
            yield f"{NO_FLOW}{method} failed on every example of {recording}: {count:,}."


def _mixed_sessions(sessions: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """What differs between the sessions of a run that was resumed."""
    told: dict[str, dict[str, None]] = {}
    for session in sessions:
        told.setdefault("git commits", {})[str(session["git_commit"])] = None
        told.setdefault("machines", {})[session["machine"]["name"]] = None
        for device in ("processor", "gpu"):
            told.setdefault(f"{device}s", {})[str(session["machine"][device])] = None
        for package, version in session["versions"].items():
            told.setdefault(f"versions of {package}", {})[version] = None
    for what, values in told.items():
        if len(values) > 1:
            listed = ", ".join(values)
            yield f"Rows of {len(sessions)} sessions with different {what}: {listed}."


def _failures(rows: Iterable[ResultRow]) -> Iterator[str]:
    """For each method that gave no flow somewhere, how often and why, told by its first failure."""
    first: dict[str, ResultRow] = {}
    counts: Counter[str] = Counter()
    for row in rows:
        if row.failure and row.failure != DROPPED:
            first.setdefault(row.method, row)
            counts[row.method] += 1
    for method, row in first.items():
        end = "" if row.failure.endswith((".", "?")) else "."
        yield (
            f"{method}: examples without a flow: {counts[method]:,}; the first, sweep {row.number} "
            f"of {row.recording}: {row.failure}{end}"
        )


def _has(names: Sequence[str]) -> str:
    return "has" if len(names) == 1 else "have"


def _listed(names: Sequence[str], limit: int = 4) -> str:
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more
