# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings that can change while running, as the page offers them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from typing import Any, Final

from mnsf_ros.setting import Setting
from mnsf_ros.settings import Settings, declared_settings
from mnsf_ros.settings_documents import settings_yaml

# Groups that only networks read, and those that only a node reads.
NETWORKS: Final = frozenset(
    ("distance", "nsfp", "mnsf_cycle", "linear", "field", "optimization", "early_stopping")
) | {"fusion", "compute"}
NODE: Final = frozenset(
    ("tf", "lidars", "lidar_1", "lidar_2", "lidar_3", "lidar_4", "output", "node")
)
_ONLINE: Final = "online"
_TITLE: Final = "Changed on the page of mnsf view; the other parameters have their defaults."


def knobs(settings: Settings, *, of_node: bool) -> dict[str, Any]:
    """Returns the settings in their groups with values and ranges, and a parameter file.

    Groups that have no effect are left out. The file has all that differs from the defaults.
    """
    hidden = NETWORKS if settings.method.name == _ONLINE else frozenset(("objects",))
    hidden |= frozenset() if of_node else NODE
    changed = [
        one.name for one in declared_settings() if settings.value_of(one.name) != one.default
    ]
    groups = _groups(settings, hidden)
    file = settings_yaml(settings, _TITLE, changed) if changed else ""
    return {"groups": groups, "file": file, "changed": changed}


def _groups(settings: Settings, hidden: Collection[str]) -> list[dict[str, Any]]:
    groups = []
    for group in fields(Settings):
        offered = [
            _knob(one, settings)
            for one in declared_settings()
            if one.group == group.name and not one.fixed
        ]
        if offered and group.name not in hidden:
            text = (type(group.default).__doc__ or "").partition("\n")[0]
            groups.append({"name": group.name, "text": text, "knobs": offered})
    return groups


def _knob(setting: Setting, settings: Settings) -> dict[str, Any]:
    return {
        "name": setting.name,
        "kind": setting.kind.__name__,
        "value": settings.value_of(setting.name),
        "default": setting.default,
        "minimum": setting.minimum,
        "maximum": setting.maximum,
        "choices": setting.choices,
        "unit": setting.unit,
        "text": setting.text,
    }
