# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The one error of this package, and the check of integers, which in Python may be anything."""

import operator
import reprlib
from typing import Final, SupportsIndex

INT32_MAX: Final = 2**31 - 1
UINT32_MAX: Final = 2**32 - 1

# Messages have any sender: their values must neither break a log line nor fill the log.
_SHORTENER: Final = reprlib.Repr()
_SHORTENER.maxstring = _SHORTENER.maxother = 80
_SHORTENER.maxlist = _SHORTENER.maxtuple = 64


class MessageError(ValueError):
    """A message that cannot be decoded, or arrays that cannot be encoded as one."""


def describe(value: object) -> str:
    """Returns the `repr` of a value on one line, shortened in the middle if it is very long."""
    return _SHORTENER.repr(value).replace("\n", " ")


def checked_integer(value: SupportsIndex, name: str, maximum: int = UINT32_MAX) -> int:
    """Returns a message's integer as a Python integer, which cannot overflow in a product.

    Raises:
        MessageError: It is no integer (floats are none), negative, or larger than `maximum`.
    """
    try:
        integer = operator.index(value)
    except TypeError:
        integer = -1
    if not 0 <= integer <= maximum:
        raise MessageError(f"{name} is {describe(value)}, expected an integer from 0 to {maximum}")
    return integer
