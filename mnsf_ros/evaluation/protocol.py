"""What the figures of a run are figures of, in sentences: no table goes without them."""

from __future__ import annotations

from collections.abc import Sequence

from mnsf_ros.evaluation.nearest_preset import nearest_preset
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.evaluation.run_record import RunIdentity, RunRecord


def protocol_text(run: RunRecord, summaries: Sequence[MethodSummary]) -> list[str]:
    """Returns sentences on what was evaluated and how.

    Args:
        run: What was run.
        summaries: What came out.
    """
    identity = run.identity
    return [
        _means_text(len(run.recordings), summaries, identity.every),
        _points_text(identity, [one.truth is not None for one in run.recordings]),
        _settings_text(identity),
        _time_text(identity, summaries),
    ]


def _means_text(num_recordings: int, summaries: Sequence[MethodSummary], every: int) -> str:
    counts = sorted({summary.num_examples for summary in summaries})
    examples = " to ".join(f"{count:,}" for count in dict.fromkeys(counts[:1] + counts[-1:]))
    recordings = "1 recording" if num_recordings == 1 else f"{num_recordings} recordings"
    noun = "example" if counts == [1] else "examples"
    text = (
        f"Every value is the mean over {examples or 'no'} {noun} from {recordings} of the value "
        "of each example that has one, however many points it has; an example is a triplet of "
        "sweeps"
    )
    if every > 1:
        text += f", and one of {every} is taken"
    missing = sum(summary.num_failed + summary.num_dropped for summary in summaries)
    if missing:
        text += f". Examples without a flow are in no mean: {missing:,}"
    if len(counts) > 1:
        text += ". Methods differ in the number of examples: compare with care"
    return f"{text}."


def _points_text(identity: RunIdentity, has_truth: Sequence[bool]) -> str:
    crop = identity.crop_and_ground
    text = (
        f"Points scored: {crop['crop.min_range_m']:g} to {crop['crop.max_range_m']:g} m away and "
        f"{crop['crop.min_height_m']:g} to {crop['crop.max_height_m']:g} m high"
    )
    if crop["ground.remove"]:
        source = "a height map"
        if identity.ground == "truth" and any(has_truth):
            source = "the truth's own flag"
            if not all(has_truth):
                source += ", a height map where there is no truth"
        text += f", without ground (by {source})"
    if identity.realtime_rate is not None:
        text += "; the methods got all points and prepared them themselves, as the live node does"
    number = identity.num_points
    given = "all of them" if number is None else f"{number:,} random ones of each sweep"
    return f"{text}; {given}, the same for all methods. Seed {identity.seed}."


def _settings_text(identity: RunIdentity) -> str:
    name, changed = nearest_preset(identity)
    changes = ", ".join(f"{key} = {value}" for key, value in changed.items())
    warm = "on" if identity.settings["warm_start.enabled"] else "off, every example from scratch"
    return f"Settings: preset {name}{f', but {changes}' if changes else ''}. Warm start: {warm}."


def _time_text(identity: RunIdentity, summaries: Sequence[MethodSummary]) -> str:
    devices = sorted({device for summary in summaries for device in summary.devices})
    threads = identity.settings["compute.num_threads"]
    text = "Time: wall time of one whole estimate, device synchronized"
    if devices:
        text += f", on {' and '.join(devices)}"
    if "cpu" in devices:
        text += f" with {threads} thread{'' if threads == 1 else 's'}"
    if identity.realtime_rate is None:
        text += "; crop and ground removal are not in it"
    else:
        text += (
            f". Played at {identity.realtime_rate:g} times real time: a triplet that a newer "
            "one overtook was dropped, as in the live node"
        )
    limited = sum(summary.stop_reasons.get("time_budget", 0) for summary in summaries)
    if limited:
        text += f". {limited:,} optimizations were ended by their time budget, so that the errors "
        text += "depend on the speed of the machine"
    return f"{text}."
