# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Declaration of arguments, and those that several subcommands have."""

import argparse
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

from mnsf_ros.cli.console import complain
from mnsf_ros.errors import RecordingError, SettingsError, plain_text
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.setting import Setting, SettingValue, settings_of
from mnsf_ros.settings import Settings, parse_assignments

RESUME = "continue an interrupted run: repeat the command and add --resume"
FORCE = "overwrite an existing recording"
# Of declared settings without a unit in their name; texts without choices are lists.
_METAVARS = {int: "N", float: "X", str: "A,B,..."}
_PRESETS = (
    "online: the node's; mnsf: the paper's networks, live; paper: MNSF as published, slow; "
    "authors: MNSF as in its authors' code"
)
ROS_NAME: Final = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
Declared = TypeVar("Declared")


class Parser(argparse.ArgumentParser):
    """Takes -5,2 as a value, and shows control characters in what it refuses as text."""

    def __init__(self, **options: Any) -> None:  # noqa: ANN401 - as argparse
        super().__init__(**options)
        # To argparse, only numbers that begin with a minus are values.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """Raises a SettingsError of one line; the usage would hide it."""
        raise SettingsError(f"{plain_text(message)}; see {self.prog} --help")


class Arguments:
    """Arguments of a subcommand, or a group of them."""

    def __init__(self, container: argparse._ActionsContainer) -> None:
        self._container = container

    def group(self, title: str) -> "Arguments":
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
            name: As in the help: `out`, `bags BAG` or `--out DIR`.
            text: For the help; the default is added to it.
            kind: Converter from text; by default the type of the default value, or str.
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

    def declared(self, group: type, *names: str, **defaults: object) -> None:
        """Adds an option for each declared field of a dataclass; `chosen` returns the result.

        With `names` only these, in this order; `defaults` replace the declared ones.
        """
        known = {one.name: one for one in settings_of(group)}
        for setting in [known[name] for name in names or known]:
            choices = "|".join(setting.choices)
            metavar = choices or setting.unit.upper() or _METAVARS[setting.kind]
            name = f"--{setting.name.replace('_', '-')} {metavar}"
            default = defaults.get(setting.name, setting.default)
            self.value(name, setting.text, _value_of(setting), default)

    def existing(self, name: str, text: str, **others: Any) -> None:  # noqa: ANN401 - as above
        """Adds an argument or option with paths, which must be there, as for `value`."""
        self.value(name, text, existing_path, **others)

    def points(self) -> None:
        """Adds `--points`, the topic of the sweeps."""
        self.value("--points TOPIC", "point clouds (needed only if there are several such topics)")

    def method(self) -> None:
        """Adds `--method`, the name of one method."""
        self.value("--method NAME", "see docs/evaluation.md (default: method.name of the preset)")

    def preset(self, text: str, default: str) -> None:
        """Adds `--preset`, the name of a preset, with its default."""
        self.value("--preset", f"{text}. {_PRESETS}", default=default, choices=PRESET_NAMES)

    def settings(self, default: str = "paper") -> None:
        """Adds `--preset` with its default, and `--set`; `chosen_settings` has the result."""
        self.preset("settings to start from; the method online always has its own", default)
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


def chosen(
    options: argparse.Namespace,
    group: type[Declared],
    **others: Any,  # noqa: ANN401 - as the fields
) -> Declared:
    """Returns a dataclass from the options of its declared fields, and its `others`."""
    values = {one.name: getattr(options, one.name, None) for one in settings_of(group)}
    return group(**others, **{k: v for k, v in values.items() if v is not None})


def chosen_settings(options: argparse.Namespace) -> Settings:
    """Returns the settings of `--preset` with the changes of `--set`.

    Raises:
        SettingsError: As `parse_assignments`.
    """
    changes = parse_assignments(options.assignments)
    settings = preset(options.preset).changed(changes)
    if settings.without_effect:
        complain(settings.without_effect)
    return settings


def _value_of(setting: Setting) -> Callable[[str], SettingValue]:
    """Returns a converter of text to a value of a setting, for `Arguments.value`."""

    def value(text: str) -> SettingValue:
        try:
            return setting.parsed(text)
        except SettingsError as error:
            # argparse names the option.
            reason = str(error).removeprefix(f"{setting.name}: ")
            raise argparse.ArgumentTypeError(reason) from None

    return value


def number_within(
    least: float, most: float, kind: Callable[[str], float] = float
) -> Callable[[str], float]:
    """Returns a converter of text to a number within bounds, for `Arguments.value`."""

    def number(text: str) -> float:
        with suppress(ValueError):
            if least <= kind(text) <= most:
                return kind(text)
        words = "" if kind is float else "a whole number from "
        raise argparse.ArgumentTypeError(
            f"got {text!r}, expected {words}{least:.12g} to {most:.12g}"
        )

    return number


def ros_name(text: str) -> str:
    """Returns the name of a node or topic.

    Raises:
        argparse.ArgumentTypeError: ROS does not allow such a name.
    """
    if not ROS_NAME.fullmatch(f"/{text.strip('/')}"):
        allowed = "letters, digits and _, such as /scene_flow"
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a name of {allowed}")
    return text


def existing_path(text: str) -> Path:
    """Returns the path of a file or folder.

    Raises:
        RecordingError: It does not exist.
    """
    if not (path := Path(text)).exists():
        raise RecordingError(f"{text}: no such file or folder")
    return path
