"""Check of the integers in a message, which in Python may hold anything."""

from __future__ import annotations

import operator
from typing import Final, SupportsIndex

from msg_utils.errors import MessageError, describe

UINT8_MAX: Final = 2**8 - 1
INT32_MAX: Final = 2**31 - 1
UINT32_MAX: Final = 2**32 - 1


def checked_integer(value: SupportsIndex, name: str, *, maximum: int) -> int:
    """Return a message's integer as a Python integer, which cannot overflow in a product.

    Args:
        value: What the message holds; NumPy integers are accepted, floats are not.
        name: What to call it in the error.
        maximum: Largest value its type can hold.

    Returns:
        The value, at least 0.

    Raises:
        MessageError: It is no integer, negative, or larger than `maximum`.
    """
    try:
        integer = operator.index(value)
    except TypeError:
        integer = None
    if integer is None or not 0 <= integer <= maximum:
        msg = f"{name} is {describe(value)}, expected an integer from 0 to {maximum}"
        raise MessageError(msg)
    return integer
