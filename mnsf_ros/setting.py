# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One setting: its declaration, and the check of its values."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Any, get_type_hints

from mnsf_ros.errors import SettingsError, shortened

SettingValue = bool | int | float | str

# End of a setting's name -> its unit.
_UNITS = {
    **{"_m_s": "m/s", "_m2": "m²", "_m": "m", "_ms": "ms", "_s": "s"},
    **{"_hz": "Hz", "_deg": "degrees"},
}
_LARGE = 1_000_000
_WORDS = {"true": True, "false": False}


@dataclass(frozen=True)
class Setting:
    """The declaration of one setting."""

    name: str  # `group.field`
    kind: type  # bool, int, float or str
    default: SettingValue  # of the `online` preset
    text: str  # one line for people
    minimum: float | None  # numbers only, as the maximum
    maximum: float | None
    choices: tuple[str, ...]  # the words allowed, strings only
    fixed: bool  # constant while a node runs
    tuned: tuple[float, float] | None  # range that `mnsf tune` searches, numbers only

    @property
    def group(self) -> str:
        """First part of the name."""
        return self.name.partition(".")[0]

    @property
    def unit(self) -> str:
        """Unit of the value, the end of the name; empty without one."""
        return next((unit for end, unit in _UNITS.items() if self.name.endswith(end)), "")

    def checked(self, value: object) -> SettingValue:
        """Returns `value` in this setting's type.

        Raises:
            SettingsError: If the type does not fit, or the value is outside the range.
        """
        typed = self._typed(value)
        if self.choices and typed not in self.choices:
            raise self._refusal(value)
        if isinstance(typed, (int, float)) and not isinstance(typed, bool):
            too_small = self.minimum is not None and typed < self.minimum
            too_large = self.maximum is not None and typed > self.maximum
            if too_small or too_large or not math.isfinite(typed):
                raise self._refusal(value)
        return typed

    def parsed(self, text: str) -> SettingValue:
        """Returns the value of a text such as `35` or `true`.

        Raises:
            SettingsError: If the type does not fit, or the value is outside the range.
        """
        value: SettingValue = text
        if self.kind is bool:
            value = _WORDS.get(text.lower(), text)
        # A text that is no number is refused by `checked`.
        for number in (float, int) if self.kind in (float, int) else ():
            with suppress(ValueError):
                value = number(text)
        return self.checked(value)

    def _typed(self, value: object) -> SettingValue:
        # bool is a subclass of int in Python, and `true` for a number is always a mistake.
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if self.kind is float and is_number:
            with suppress(OverflowError):  # a whole number of more than 308 digits
                return float(value)  # type: ignore[arg-type]
        if self.kind is int and isinstance(value, float) and value.is_integer():
            return int(value)
        if type(value) is self.kind:
            return value  # type: ignore[return-value]
        raise self._refusal(value)

    def _refusal(self, value: object) -> SettingsError:
        text = f"{self.name}: got {shortened(value)}, expected {self._expected()}"
        return SettingsError(text)

    def _expected(self) -> str:
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}
        return f"{words[self.kind]}{self.range_text(' from {} to {}')}"

    def range_text(self, pattern: str = "{} to {}") -> str:
        """The range as text, empty where there is none."""
        if self.choices:
            return ", ".join(self.choices)
        if self.minimum is None or self.maximum is None:
            return ""
        return pattern.format(_plain(self.minimum), _plain(self.maximum))


def _plain(number: float) -> str:
    # A float has too few digits for the largest whole numbers.
    return f"{number:g}" if abs(number) < _LARGE else str(int(number))


def declared(
    default: SettingValue,
    text: str,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    fixed: bool = False,
    tuned: tuple[float, float] | None = None,
) -> Any:  # noqa: ANN401 - dataclasses.field is typed like this, too
    """Returns the field of a dataclass that declares a setting; see the fields of Setting."""
    metadata = {"text": text, "minimum": minimum, "maximum": maximum}
    others = {"choices": choices, "fixed": fixed, "tuned": tuned}
    return field(default=default, metadata=metadata | others)


def settings_of(group: type, prefix: str = "") -> Iterator[Setting]:
    """Yields what a dataclass declares, in order, with a prefix before the names."""
    kinds = get_type_hints(group)
    for item in (one for one in fields(group) if one.metadata):
        name = f"{prefix}{item.name}"
        yield Setting(name, kinds[item.name], getattr(group, item.name), **item.metadata)


def check_declared(group: Any) -> None:  # noqa: ANN401 - any dataclass
    """Checks the declared fields of a frozen dataclass, and sets each in its type.

    Raises:
        SettingsError: If a type does not fit, or a value is outside its range.
    """
    for setting in settings_of(type(group)):
        object.__setattr__(group, setting.name, setting.checked(getattr(group, setting.name)))
