# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Named sets of settings: `online`, the default; `mnsf`, warm-started networks at sensor rate.

For comparison: `paper`, the published method, and `authors`, their released code.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

from mnsf_ros.errors import SettingsError
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings, parse_assignments

# Section 3 of the paper at the rate of the sensor: docs/method.md has what each choice buys.
_MNSF: dict[str, SettingValue] = {
    "method.name": "mnsf",
    "live.enabled": True,
    "distance.kind": "cells",
    "distance.truncation_m": 1.0,
    "field.num_hidden_layers": 2,
    "field.hidden_width": 64,
    "optimization.learning_rate": 0.005,
    "optimization.decay": False,
    "optimization.max_iterations": 10,
    "optimization.max_points": 256,
    "optimization.time_budget_ms": 0.0,
    "fusion.num_hidden_layers": 2,
    "fusion.hidden_width": 32,
    "fusion.max_iterations": 1,
}

# Section 3 of the paper and the settings of the authors' README, every triplet from scratch.
_PAPER: dict[str, SettingValue] = {
    "method.name": "mnsf",
    "crop.min_range_m": 0.0,
    "distance.kind": "grid",
    "distance.cell_size_m": 0.1,
    "distance.truncation_m": 0.0,
    "field.num_hidden_layers": 8,
    "field.hidden_width": 128,
    "optimization.learning_rate": 0.01,
    "optimization.decay": False,
    "optimization.max_iterations": 5000,
    "optimization.time_budget_ms": 0.0,
    "early_stopping.patience": 10,
    "early_stopping.min_delta_m": 0.001,
    "fusion.kind": "mlp",
    "fusion.num_hidden_layers": 3,
    "fusion.hidden_width": 128,
    "fusion.max_iterations": 5000,
    # The paper is silent. With the 30 of the authors' README the fusion overfits: docs/method.md.
    "fusion.patience": 10,
    "warm_start.enabled": False,
    # An estimate takes seconds.
    "node.max_latency_ms": 0.0,
}

# The released code of the authors where it does something else than the paper says.
_AUTHORS: dict[str, SettingValue] = _PAPER | {
    "optimization.joint": True,
    "fusion.input": "sum",
    "fusion.fields": "last",
    "fusion.patience": 30,
    "nsfp.weight_decay": 0.0001,
    "nsfp.min_delta_m2": 0.0001,
}

_PRESETS: dict[str, dict[str, SettingValue]] = {
    "online": {},
    "mnsf": _MNSF,
    "paper": _PAPER,
    "authors": _AUTHORS,
}

PRESET_NAMES = tuple(_PRESETS)


def preset(name: str) -> Settings:
    """The settings of a preset.

    Raises:
        SettingsError: If there is no preset of that name.
    """
    if name not in _PRESETS:
        raise SettingsError(f"unknown preset {name!r}, expected one of {', '.join(_PRESETS)}")
    return replace(Settings().changed(_PRESETS[name]), explicit=frozenset())


def nearest_preset(
    settings: Settings, ignored: Collection[str], named: Collection[str] = ()
) -> tuple[str, dict[str, SettingValue]]:
    """Returns the name of the preset with fewest differences, and the settings that differ.

    Args:
        settings: The settings to compare.
        ignored: Names of settings that are not compared.
        named: Names of those that count as different whatever their value.
    """
    values = {k: value for k, value in settings.to_mapping().items() if k not in ignored}
    changes = {}
    for name in PRESET_NAMES:
        usual = preset(name).to_mapping()
        changes[name] = {k: v for k, v in values.items() if usual[k] != v or k in named}
    nearest = min(changes, key=lambda name: len(changes[name]))
    return nearest, changes[nearest]


def settings_for(method: str, settings: Settings) -> Settings:
    """Returns the settings of a method by its name.

    A variant, see `variant_of`, has those of its preset, then the explicit settings, then its own
    changes.

    A method with a preset of its own name, such as `online`, gets that preset in place of another
    method's, and the explicit settings on top. So `mnsf evaluate --preset paper` runs `online` as
    the robot does, and `--set` still holds for it, whatever the value.

    Args:
        method: Name of a method or variant.
        settings: A preset, possibly with changes. `method.name` is the method that it is made for.

    Raises:
        SettingsError: As `variant_of`.
    """
    variant = variant_of(method)
    # A user who names `online` on top of `paper` wants the preset `online`; one who names `mnsf`
    # there has the settings of `mnsf` as published already.
    is_given = "method.name" in settings.explicit and variant.method == "online"
    is_for_method = settings.method.name == variant.method and not is_given
    name = variant.preset
    if not name and variant.method in _PRESETS and not is_for_method:
        name = variant.method
    if name:
        explicit = {one: settings.value_of(one) for one in settings.explicit}
        settings = preset(name).changed(explicit)
    return settings.changed(variant.changes)


class Variant(NamedTuple):
    """A method with settings, by its name `PRESET/METHOD+SETTING=VALUE`."""

    preset: str  # its name; empty if the name has none
    method: str  # its name
    changes: dict[str, SettingValue]  # setting to value


def variant_of(method: str) -> Variant:
    """Returns the parts of a name: `mnsf`, `paper/mnsf`, `paper/mnsf+fusion.kind=mean`.

    Raises:
        SettingsError: The preset or a setting is unknown, or a value cannot be used.
    """
    if ":" in method:  # a command, or a folder of files
        return Variant("", method, {})
    start, *changes = method.split("+")
    preset_name, slash, name = start.rpartition("/")
    if slash:
        try:
            preset(preset_name)
        except SettingsError as error:
            raise SettingsError(f"method {method!r}: {error}") from error
    return Variant(preset_name, name, parse_assignments(changes))
