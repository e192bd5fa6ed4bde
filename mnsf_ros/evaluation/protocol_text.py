"""What the figures of a run are figures of, in sentences: no table goes without them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from mnsf_ros.evaluation.evaluation_options import ALL_POINTS
from mnsf_ros.evaluation.findings import SWEEPS_READ
from mnsf_ros.evaluation.result_row import DROPPED, ResultRow
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.presets import PRESET_NAMES, preset

# Set by the evaluator itself, and told apart from the settings.
_OWN = ("compute.seed", "compute.num_threads", "ground.remove")


def protocol_text(run: Mapping[str, Any], summaries: Sequence[MethodSummary]) -> list[str]:
    """Returns sentences on what was evaluated and how.

    Args:
        run: The record of the run, see `run.json`.
        summaries: What came out.
    """
    identity = run["identity"]
    return [
        _means_text(len(run["recordings"]), summaries),
        _points_text(identity, [one["truth"] is not None for one in run["recordings"]]),
        _settings_text(identity["settings"], identity["crop_and_ground"]),
        _time_text(identity, summaries),
    ]


def notes_text(
    run: Mapping[str, Any], finished: Iterable[Mapping[str, Any]], rows: Iterable[ResultRow] = ()
) -> list[str]:
    """Returns one line for each thing that makes figures less certain, or explains a gap in them.

    Args:
        run: The record of the run.
        finished: What was noticed in each finished task, see `tasks.jsonl`.
        rows: What came out; methods that gave no flow say why.
    """
    recordings = run["recordings"]
    notes: dict[str, None] = {}
    for recording in recordings:
        notes.update(dict.fromkeys(f"Damage: {damage}" for damage in recording["damages"]))
    finished = list(finished)
    for task in finished:
        notes.update(dict.fromkeys(f"Damage: {damage}" for damage in task["damages"]))
    notes.update(dict.fromkeys(_failures(rows)))
    unchecked = [one["name"] for one in recordings if not one["has_checksums"]]
    if unchecked:
        notes[
            f"{_listed(unchecked)}: {_has(unchecked)} no checksums, so that flipped bits within a "
            "message would have gone unnoticed."
        ] = None
    without_truth = [one["name"] for one in recordings if one["truth"] is None]
    if without_truth:
        names = f"{_listed(without_truth)}: {_has(without_truth)}"
        notes[f"{names} no truth, so there are no errors."] = None
    for task in finished:
        for event, count in task["counts"].items():
            if event != SWEEPS_READ:
                notes[f"{task['recording']}: {event}: {count:,}."] = None
    return list(notes)


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


def _means_text(num_recordings: int, summaries: Sequence[MethodSummary]) -> str:
    counts = sorted({summary.num_examples for summary in summaries})
    examples = " to ".join(f"{count:,}" for count in dict.fromkeys(counts[:1] + counts[-1:]))
    recordings = "1 recording" if num_recordings == 1 else f"{num_recordings} recordings"
    text = (
        f"Every value is the mean over {examples or 'no'} examples from {recordings} of the value "
        "of each example that has one, however many points it has; an example is a triplet of "
        "sweeps"
    )
    missing = sum(summary.num_failed + summary.num_dropped for summary in summaries)
    if missing:
        text += f". Examples without a flow are in no mean: {missing:,}"
    if len(counts) > 1:
        text += ". Methods differ in the number of examples: compare with care"
    return f"{text}."


def _points_text(identity: Mapping[str, Any], has_truth: Sequence[bool]) -> str:
    crop = identity["crop_and_ground"]
    text = (
        f"Points scored: {crop['crop.min_range_m']:g} to {crop['crop.max_range_m']:g} m away and "
        f"{crop['crop.min_height_m']:g} to {crop['crop.max_height_m']:g} m high"
    )
    if crop["ground.remove"]:
        source = "a height map"
        if identity["ground"] == "truth" and any(has_truth):
            source = "the truth's own flag"
            if not all(has_truth):
                source += ", a height map where there is no truth"
        text += f", without ground (by {source})"
    if identity["realtime_rate"] is not None:
        text += "; the methods got all points and prepared them themselves, as the live node does"
    number = identity["num_points"]
    given = "all of them" if number == ALL_POINTS else f"{number:,} random ones of each sweep"
    return f"{text}; {given}, the same for all methods. Seed {identity['seed']}."


def _settings_text(settings: Mapping[str, Any], crop_and_ground: Mapping[str, Any]) -> str:
    asked = {**settings, **crop_and_ground}
    differences = {
        name: {
            key: asked[key]
            for key, value in preset(name).to_mapping().items()
            if key in asked and asked[key] != value and (key not in _OWN or key in crop_and_ground)
        }
        for name in PRESET_NAMES
    }
    nearest = min(differences, key=lambda name: len(differences[name]))
    changes = ", ".join(f"{key} = {value}" for key, value in differences[nearest].items())
    warm = "on" if settings["warm_start.enabled"] else "off, every example from scratch"
    return f"Settings: preset {nearest}{f', but {changes}' if changes else ''}. Warm start: {warm}."


def _time_text(identity: Mapping[str, Any], summaries: Sequence[MethodSummary]) -> str:
    devices = sorted({device for summary in summaries for device in summary.devices})
    threads = identity["settings"]["compute.num_threads"]
    text = "Time: wall time of one whole estimate, device synchronized"
    if devices:
        text += f", on {' and '.join(devices)}"
    if "cpu" in devices:
        text += f" with {threads} thread{'' if threads == 1 else 's'}"
    if identity["realtime_rate"] is None:
        text += "; crop and ground removal are not in it"
    else:
        text += (
            f". Played at {identity['realtime_rate']:g} times real time: a triplet that a newer "
            "one overtook was dropped, as in the live node"
        )
    limited = sum(summary.stop_reasons.get("time_budget", 0) for summary in summaries)
    if limited:
        text += f". {limited:,} optimizations were ended by their time budget, so that the errors "
        text += "depend on the speed of the machine"
    return f"{text}."
