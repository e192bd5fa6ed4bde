"""The wire format of protocol buffers: numbered fields, without knowing the message type."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_MAX_VARINT_BYTES: Final = 10


class WireMessage:
    """The fields of one message; nested messages stay bytes until asked for.

    Raises:
        ValueError: On construction, if the bytes are no message.
    """

    def __init__(self, data: bytes | memoryview) -> None:
        self._fields: dict[int, list[int | memoryview]] = {}
        view, position = memoryview(data), 0
        while position < len(view):
            tag, position = _varint(view, position)
            value, position = _value(view, position, tag & 7)
            self._fields.setdefault(tag >> 3, []).append(value)

    def messages(self, number: int) -> list[WireMessage]:
        """Returns the nested messages of a field, possibly none."""
        return [WireMessage(_as_bytes(value)) for value in self._fields.get(number, [])]

    def message(self, number: int) -> WireMessage:
        """Returns a nested message; an absent one is empty."""
        # Of several, the last one counts.
        return (self.messages(number) or [WireMessage(b"")])[-1]

    def data(self, number: int) -> bytes:
        """Returns a field of bytes; an absent one is empty."""
        values = self._fields.get(number, [])
        return bytes(_as_bytes(values[-1])) if values else b""

    def text(self, number: int) -> str:
        """Returns a field of text; an absent one is empty."""
        return self.data(number).decode("utf-8")

    def integer(self, number: int) -> int:
        """Returns a field of a signed or unsigned integer or an enum; an absent one is 0."""
        return ([0, *self.integers(number)])[-1]

    def integers(self, number: int) -> list[int]:
        """Returns a repeated field of integers, packed or not."""
        found: list[int] = []
        for value in self._fields.get(number, []):
            if isinstance(value, int):
                found.append(_signed(value))
                continue
            position = 0
            while position < len(value):
                packed, position = _varint(value, position)
                found.append(_signed(packed))
        return found

    def double(self, number: int) -> float:
        """Returns a field of a double; an absent one is 0."""
        values = self.doubles(number)
        return float(values[-1]) if len(values) else 0.0

    def doubles(self, number: int) -> NDArray[np.float64]:
        """Returns a repeated field of doubles, packed or not."""
        return self._numbers(number, np.dtype("<f8")).astype(np.float64)

    def floats(self, number: int) -> NDArray[np.float32]:
        """Returns a repeated field of floats, packed or not."""
        return self._numbers(number, np.dtype("<f4")).astype(np.float32)

    def _numbers(self, number: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        parts = [_as_bytes(value) for value in self._fields.get(number, [])]
        return np.frombuffer(b"".join(parts), dtype=dtype)


def _value(view: memoryview, position: int, kind: int) -> tuple[int | memoryview, int]:
    if kind == _VARINT:
        return _varint(view, position)
    if kind == _BYTES:
        length, position = _varint(view, position)
    elif kind in (_FIXED64, _FIXED32):
        length = 8 if kind == _FIXED64 else 4
    else:
        raise ValueError(f"wire type {kind} at byte {position}, so this is no message")
    if position + length > len(view):
        raise ValueError(f"a field of {length} bytes at byte {position} is cut short")
    return view[position : position + length], position + length


def _varint(view: memoryview, position: int) -> tuple[int, int]:
    value = 0
    for index in range(_MAX_VARINT_BYTES):
        if position + index >= len(view):
            raise ValueError(f"an integer at byte {position} is cut short")
        byte = view[position + index]
        value |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return value, position + index + 1
    raise ValueError(f"an integer at byte {position} has no end")


def _signed(value: int) -> int:
    (signed,) = struct.unpack("<q", struct.pack("<Q", value & (2**64 - 1)))
    return int(signed)


def _as_bytes(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise ValueError("a field that should hold bytes holds an integer")
    return value
