# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The settings as text: the YAML files in `config/` and the table in `docs/`."""

import textwrap
from collections.abc import Collection

from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import Settings, declared_settings

_WIDTH = 96
# Their settings are those of the group `lidar_1`.
_LIKE_LIDAR_1 = ("lidar_2", "lidar_3", "lidar_4")


def settings_yaml(settings: Settings, title: str, names: Collection[str] | None = None) -> str:
    """A ROS parameter file that sets all parameters, each under a comment that explains it.

    With `names`, only those that have one of these full names.

    Headed `/**:` because a file headed with a node's name is silently ignored once the node is
    renamed or put into a namespace. The title is its first comment.
    """
    lines = [f"# {line}" for line in textwrap.wrap(title, _WIDTH - 2)]
    lines += ["/**:", "  ros__parameters:"]
    group = ""
    for setting in declared_settings():
        if names is not None and setting.name not in names:
            continue
        new_group, _, key = setting.name.partition(".")
        if new_group != group:
            lines.append(f"    {new_group}:")
            group = new_group
        lines += [f"      # {line}" for line in textwrap.wrap(_comment(setting), _WIDTH - 8)]
        lines.append(f"      {key}: {_scalar(settings.value_of(setting.name))}")
    return "\n".join(lines) + "\n"


def settings_markdown(presets: dict[str, Settings]) -> str:
    """A table of all settings: value in the first preset, and in others where it differs."""
    first, *others = presets
    header = ["setting", "meaning", "range", first, ", ".join(others)]
    rows = [header, ["---"] * len(header)]
    for setting in declared_settings():
        if setting.group in _LIKE_LIDAR_1:
            continue
        value, *further = (_scalar(each.value_of(setting.name)) for each in presets.values())
        fixed = " (fixed at start)" if setting.fixed else ""
        span = " ".join(filter(None, (setting.range_text(), setting.unit)))
        changed = "" if set(further) == {value} else ", ".join(further)
        rows.append([f"`{setting.name}`", f"{setting.text}{fixed}", span, value, changed])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


def _comment(setting: Setting) -> str:
    remarks = [setting.unit, setting.range_text(), "fixed at start" if setting.fixed else ""]
    remark = "; ".join(filter(None, remarks))
    return f"{setting.text} [{remark}]" if remark else setting.text


def _scalar(value: SettingValue) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        # Never 1e-07: YAML 1.1 reads that as a word.
        digits = f"{value:.9f}".rstrip("0")
        return f"{digits}0" if digits.endswith(".") else digits
    return str(value) or '""'
