"""LZF, the compression of PCD files: literal runs and references to what came before."""

from __future__ import annotations

from typing import Final

_MAX_LITERAL: Final = 32
_LONG_LENGTH: Final = 7
# A reference of 3 bytes stands for at most so many.
_MAX_GROWTH: Final = 264


def decompress(data: bytes, num_bytes: int) -> bytes:
    """Decompresses a block.

    Args:
        data: The compressed bytes.
        num_bytes: What they give.

    Raises:
        ValueError: If they give another number of bytes, or refer to what is not there.
    """
    if num_bytes > len(data) * _MAX_GROWTH:
        raise ValueError(f"{len(data)} compressed bytes cannot give {num_bytes}")
    output = bytearray()
    place = 0
    while place < len(data):
        control = data[place]
        place += 1
        if control < _MAX_LITERAL:
            output += data[place : place + control + 1]
            place += control + 1
        else:
            place = _copy_reference(data, place, control, output)
        if len(output) > num_bytes or place > len(data):
            break
    if len(output) != num_bytes or place != len(data):
        raise ValueError(f"the compressed block is damaged: it does not give {num_bytes} bytes")
    return bytes(output)


def _copy_reference(data: bytes, place: int, control: int, output: bytearray) -> int:
    """Appends what a reference stands for and returns the place after it."""
    length = control >> 5
    if length == _LONG_LENGTH:
        length += data[place]
        place += 1
    start = len(output) - ((control & 31) << 8) - data[place] - 1
    length += 2
    if start < 0:
        raise ValueError("the compressed block is damaged: it refers to before its start")
    # The copy may reach into itself: then what is there repeats.
    piece = bytes(output[start : start + length])
    repeats = -(-length // len(piece))
    output += (piece * repeats)[:length]
    return place + 1
