"""Settings said in few words: the preset that they are nearest to, and what differs from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mnsf_ros.presets import PRESET_NAMES, preset

# Set by the evaluator itself.
_OWN = ("compute.seed", "compute.num_threads", "ground.remove")


def nearest_preset(
    settings: Mapping[str, Any], crop_and_ground: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Returns the name of a preset, and name to value of the settings that it has otherwise.

    Args:
        settings: What the methods got, without what the evaluator sets itself.
        crop_and_ground: What points were taken.
    """
    asked = {name: value for name, value in settings.items() if name not in _OWN}
    asked.update(crop_and_ground)
    changes = {
        name: {
            key: asked[key]
            for key, value in preset(name).to_mapping().items()
            if key in asked and asked[key] != value
        }
        for name in PRESET_NAMES
    }
    nearest = min(changes, key=lambda name: len(changes[name]))
    return nearest, changes[nearest]
