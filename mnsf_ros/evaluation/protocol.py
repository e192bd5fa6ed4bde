"""What was evaluated and how, in sentences: they stand above or below every table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.evaluation.run_record import RunIdentity, RunRecord
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import SettingValue

# Set by the evaluator itself.
_OWN: Final = ("compute.seed", "compute.num_threads", "ground.remove")


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


def nearest_preset(identity: RunIdentity) -> tuple[str, dict[str, SettingValue]]:
    """Returns the name of a preset, and the settings of a run that differ or were set by hand."""
    asked = {name: value for name, value in identity.settings.items() if name not in _OWN}
    asked.update(identity.crop_and_ground)
    explicit = identity.explicit or ()
    changes = {
        name: {
            key: asked[key]
            for key, value in preset(name).to_mapping().items()
            if key in asked and (asked[key] != value or key in explicit)
        }
        for name in PRESET_NAMES
    }
    nearest = min(changes, key=lambda name: len(changes[name]))
    return nearest, changes[nearest]


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


def _points_text(identity: RunIdentity, has_truth: Sequence[bool]) -> str:
    crop = identity.crop_and_ground
    text = (
        f"Scored points: range {crop['crop.min_range_m']:g} to {crop['crop.max_range_m']:g} m, "
        f"height {crop['crop.min_height_m']:g} to {crop['crop.max_height_m']:g} m"
    )
    if crop["ground.remove"]:
        source = "height map"
        if identity.ground == "truth" and any(has_truth):
            source = "flag in the truth"
            if not all(has_truth):
                source += ", height map where there is no truth"
        text += f", without ground ({source})"
    number = identity.num_points
    chosen = "all" if number is None else f"{number:,} random points of each sweep"
    return f"{text}; {chosen}, the same for all methods. Seed {identity.seed}."


def _settings_text(identity: RunIdentity) -> str:
    name, changed = nearest_preset(identity)
    changes = ", ".join(f"{key} = {value}" for key, value in changed.items())
    warm = "on" if identity.settings["warm_start.enabled"] else "off"
    return f"Settings: preset {name}{f' with {changes}' if changes else ''}. Warm start: {warm}."


def _time_text(identity: RunIdentity, summaries: Sequence[MethodSummary]) -> str:
    devices = sorted({device for summary in summaries for device in summary.devices})
    threads = identity.settings["compute.num_threads"]
    text = "Time: wall time of one estimate without the choice of points, device synchronized"
    if devices:
        text += f", on {' and '.join(devices)}"
    if "cpu" in devices:
        text += f" with {threads} thread{'' if threads == 1 else 's'}"
    if identity.realtime_rate is not None:
        text += (
            f". Replay at {identity.realtime_rate:g} times real time, simulated from measured run "
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
