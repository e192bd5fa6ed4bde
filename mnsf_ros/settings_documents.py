# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The settings as text: the YAML files in `config/` and the table in `docs/`."""

from __future__ import annotations

import textwrap
from collections.abc import Collection

from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import Settings, declared_settings

_WIDTH = 96


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
    """A table of all settings, with one column for each preset."""
    names = list(presets)
    header = ["setting", "meaning", "unit", "range", *names]
    rows = [header, ["---"] * len(header)]
    for setting in declared_settings():
        values = [_scalar(presets[name].value_of(setting.name)) for name in names]
        fixed = " (fixed at start)" if setting.fixed else ""
        text = f"{setting.text}{fixed}"
        rows.append([f"`{setting.name}`", text, setting.unit, setting.range_text(), *values])
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
