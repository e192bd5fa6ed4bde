# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Entries of JSON objects, checked before they are used."""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final


@dataclass(frozen=True)
class Kind:
    """What an entry may be: what an error calls it, and whether a value is of it."""

    name: str
    fits: Callable[[Any], bool]


# In Python, True is a number, too; JSON gives no other subclasses.
def _is_number(value: object) -> bool:
    return type(value) in (int, float)


def numbers(count: int) -> Kind:
    """Returns the kind of a list with so many numbers, which may be NaN."""
    return Kind(
        f"{count} numbers",
        lambda value: type(value) is list and len(value) == count and all(map(_is_number, value)),
    )


TEXT: Final = Kind("a text", lambda value: type(value) is str)
NUMBER: Final = Kind("a number", _is_number)
TRACK: Final = Kind(
    "a text, an integer or null", lambda value: value is None or type(value) in (str, int)
)
# Later than any ROS message can be; what is not finite is out of range, too.
MICROSECONDS: Final = Kind(
    "microseconds since 1970", lambda value: _is_number(value) and 0 <= value < 2**63
)


def entry(row: object, name: str, kind: Kind) -> Any:  # noqa: ANN401
    """Returns an entry of an object.

    Raises:
        ValueError: It is of another kind, or the row is no object.
        KeyError: The object has no such entry.
    """
    if not isinstance(row, dict):
        raise ValueError(f"holds {reprlib.repr(row)}, expected an object")
    value = row[name]
    if not kind.fits(value):
        raise ValueError(f"{name!r} is {reprlib.repr(value)}, expected {kind.name}")
    return value
