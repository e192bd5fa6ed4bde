# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Declaration of arguments, and those that several subcommands have."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from mnsf_ros.errors import RecordingError, plain_text
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.setting import settings_of
from mnsf_ros.settings import Settings, parse_assignments

ALL = "all"
RESUME = "continue an interrupted run: repeat the command and add --resume"
FORCE = "overwrite an existing recording"
# Of declared settings without a unit in their name.
_METAVARS = {int: "N", float: "SHARE", str: "NAME"}
Declared = TypeVar("Declared")


class IntermixedParser(argparse.ArgumentParser):
    """Options may stand anywhere; argparse alone gives up on `NAME --option X BAG...`."""

    _is_inside = False

    def parse_known_args(  # type: ignore[override]  # argparse has overloads of the same
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401 - as argparse
    ) -> tuple[Any, list[str]]:
        """Parses options first, then the rest by a second call of this method.

        Unknown options are refused here, with the usage of this subcommand.
        """
        if self._is_inside:
            return super().parse_known_args(args, namespace)
        self._is_inside = True
        try:
            known, unknown = self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_inside = False
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(map(plain_text, unknown))}")
        return known, unknown


class Arguments:
    """Arguments of a subcommand, or a group of them."""

    def __init__(self, container: argparse._ActionsContainer) -> None:
        self._container = container

    def group(self, title: str) -> Arguments:
        """Returns a new group, which the help shows under its title."""
        return Arguments(self._container.add_argument_group(title))

    def flag(self, name: str, text: str) -> None:
        """Adds an option without a value."""
        self._container.add_argument(name, action="store_true", help=text)

    def value(
        self,
        name: str,
        text: str,
        kind: Callable[[str], object] | None = None,
        default: object = None,
        **others: Any,  # noqa: ANN401 - as argparse
    ) -> None:
        """Adds an argument with a value, or an option with one.

        Args:
            name: As the help shows it: `out`, `bags BAG`, `--out DIR` or `-o --out DIR`.
            text: What the help says; the default is added to it.
            kind: Converter from text; if not given, the type of the default, or str.
            default: The default value; None has to be explained by the text.
            others: Further arguments of `argparse.add_argument`.
        """
        if default is not None:
            text, kind = f"{text} (default: {default})", kind or type(default)
        words = name.split()
        names = [word for word in words if word.startswith("-")] or words[:1]
        metavar = words[-1] if words[-1] not in names else None
        self._container.add_argument(
            *names, metavar=metavar, help=text, type=kind or str, default=default, **others
        )

    def declared(self, group: type) -> None:
        """Adds an option for each declared field of a dataclass; `chosen` returns the result."""
        for setting in settings_of(group):
            metavar = setting.unit.upper() or _METAVARS[setting.kind]
            name = f"--{setting.name.replace('_', '-')} {metavar}"
            self.value(name, setting.text, default=setting.default)

    def recordings(self, name: str, text: str, **others: Any) -> None:  # noqa: ANN401 - as above
        """Adds an argument or option with recordings, which must be there, as for `value`."""
        self.value(name, text, _existing, **others)

    def points(self) -> None:
        """Adds `--points`, the topic of the sweeps."""
        self.value("--points TOPIC", "point clouds (needed only if there are several such topics)")

    def method(self) -> None:
        """Adds `--method`, the name of one method."""
        self.value("--method NAME", "see docs/evaluation.md (default: method.name of the preset)")

    def settings(self, default: str = "paper") -> None:
        """Adds `--preset` with its default, and `--set`; `chosen_settings` has the result."""
        self.value(
            "--preset",
            "settings to start from, except for online and neural, which have their own: paper is "
            "the method as published, authors its released code, neural the same live, online the "
            "default of the live node",
            default=default,
            choices=PRESET_NAMES,
        )
        self.assignments("change a setting, for example crop.max_range_m=35; may be repeated")

    def assignments(self, text: str) -> None:
        """Adds `--set`; `parse_assignments` has the result."""
        self._container.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="NAME=VALUE",
            dest="assignments",
            help=text,
        )


def chosen(options: argparse.Namespace, group: type[Declared]) -> Declared:
    """Returns a dataclass from the options of its declared fields."""
    return group(**{one.name: getattr(options, one.name) for one in settings_of(group)})


def chosen_settings(options: argparse.Namespace) -> Settings:
    """Returns the settings of `--preset` with the changes of `--set`.

    Raises:
        SettingsError: As `parse_assignments`.
    """
    changes = parse_assignments(options.assignments)
    return preset(options.preset).changed(changes)


def _existing(text: str) -> Path:
    if not (path := Path(text)).exists():
        raise RecordingError(f"{text}: no such file or folder")
    return path


def number_or_all(text: str) -> int | str:
    """Returns a number of points, or `ALL`.

    Raises:
        ArgumentTypeError: The text is neither.
    """
    if text != ALL and not text.lstrip("+-").isdecimal():
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number or {ALL!r}")
    return ALL if text == ALL else int(text)
