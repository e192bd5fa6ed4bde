"""Settings said in few words: the preset that they are nearest to, and what differs from it."""

from __future__ import annotations

from mnsf_ros.evaluation.run_record import RunIdentity
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import SettingValue

# Set by the evaluator itself.
_OWN = ("compute.seed", "compute.num_threads", "ground.remove")


def nearest_preset(identity: RunIdentity) -> tuple[str, dict[str, SettingValue]]:
    """Returns the name of a preset, and the settings of a run that differ from it."""
    asked = {name: value for name, value in identity.settings.items() if name not in _OWN}
    asked.update(identity.crop_and_ground)
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
