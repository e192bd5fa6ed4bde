"""What subcommands share: settings as `name=value`, and options that may stand anywhere."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import PRESET_NAMES
from mnsf_ros.settings import SettingValue, declared_setting

_WORDS = {"true": True, "false": False}


def add_setting_arguments(group: argparse._ActionsContainer) -> None:
    """Adds `--preset` and `--set` to a parser or one of its groups."""
    group.add_argument(
        "--preset",
        choices=PRESET_NAMES,
        default="paper",
        help="settings to start from: paper is the method as published, authors its released code, "
        "online the default of the live node (default: paper)",
    )
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="assignments",
        help="change a setting, for example crop.max_range_m=35; may be repeated",
    )


def parse_assignments(texts: Iterable[str]) -> dict[str, SettingValue]:
    """Returns the settings that texts such as `crop.max_range_m=35` name, with their values.

    Raises:
        SettingsError: A text is no assignment, the setting is unknown, or the value is not of its
            type or outside its range.
    """
    return dict(map(_parsed, texts))


def _parsed(text: str) -> tuple[str, SettingValue]:
    name, equals, value = text.partition("=")
    if not equals:
        raise SettingsError(f"got {text!r}, expected NAME=VALUE")
    setting = declared_setting(name.strip())
    return setting.name, setting.checked(_typed(value.strip(), setting.kind))


def _typed(value: str, kind: type) -> SettingValue:
    if kind is bool:
        return _WORDS.get(value.lower(), value)
    # What is no number stays a text, for which the setting has the better words.
    if kind is int:
        with suppress(ValueError):
            return int(value)
    if kind in (int, float):
        with suppress(ValueError):
            return float(value)
    return value


class IntermixedParser(argparse.ArgumentParser):
    """argparse gives up on `NAME --option X BAG...`, because it takes NAME and no BAG at once."""

    _is_inside = False

    def parse_known_args(  # type: ignore[override]  # argparse has overloads of the same
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401 - as argparse
    ) -> tuple[Any, list[str]]:
        """Parses options first, then what is left; that calls this method once more."""
        if self._is_inside:
            return super().parse_known_args(args, namespace)
        self._is_inside = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_inside = False
