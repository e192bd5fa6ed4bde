"""PCD files of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.decompression import check_size
from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.sweep_in_file import (
    SweepInFile,
    parse_rows,
    read_bytes,
    reading,
    xyz_of_columns,
)

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
    check_size(num_bytes, "the decompressed data")
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


_KINDS: Final = {"F": "f", "I": "i", "U": "u"}
_TYPES: Final = frozenset({"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"})
_MAX_HEADER_LINES: Final = 100


@dataclass(frozen=True)
class _Field:
    """One field of the points: `count` values of a NumPy type."""

    name: str
    type: str
    count: int

    @property
    def num_bytes(self) -> int:
        return int(self.type[1:]) * self.count


@dataclass(frozen=True)
class _Header:
    fields: tuple[_Field, ...]
    num_points: int
    encoding: str
    length: int

    @property
    def num_bytes(self) -> int:
        """Bytes of a point."""
        return sum(field.num_bytes for field in self.fields)


def read_pcd(path: Path) -> SweepInFile:
    """Reads the fields x, y and z. The viewpoint in the header is not applied.

    Raises:
        SweepFileError: If the file is missing, damaged, cut short, or has no such fields.
    """
    content = read_bytes(path)
    with reading(path):
        header = _parse_header(content)
        names = [field.name for field in header.fields]
        if not {"x", "y", "z"} <= set(names):
            raise SweepFileError(f"{path}: has no field x, y, z; it has {', '.join(names)}")
        columns = _READERS[header.encoding](header, content[header.length :])
        return SweepInFile(xyz_of_columns(path, columns))


def _parse_header(content: bytes) -> _Header:
    entries: dict[str, list[str]] = {}
    place = 0
    for _ in range(_MAX_HEADER_LINES):
        end = content.find(b"\n", place)
        if end < 0:
            break
        words = content[place:end].decode("ascii").split()
        place = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0]] = words[1:]
        if words[:1] == ["DATA"]:
            return _header(entries, place)
    raise ValueError("its header has no line DATA")


def _header(entries: dict[str, list[str]], length: int) -> _Header:
    names, sizes, kinds = (entries[key] for key in ("FIELDS", "SIZE", "TYPE"))
    counts = entries.get("COUNT", ["1"] * len(names))
    fields = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        field = _Field(name, f"{_KINDS.get(kind, kind)}{size}", int(count))
        if field.type not in _TYPES or field.count < 0:
            raise ValueError(f"field {name} is {count} times {kind} of size {size}")
        fields.append(field)
    shape = [int(entries[key][0]) for key in ("WIDTH", "HEIGHT")]
    num_points = int(entries["POINTS"][0]) if "POINTS" in entries else math.prod(shape)
    encoding = " ".join(entries["DATA"])
    if encoding not in _READERS:
        raise ValueError(f"its data is {encoding!r}, expected one of {', '.join(_READERS)}")
    if num_points < 0:
        raise ValueError(f"it has {num_points} points")
    return _Header(tuple(fields), num_points, encoding, length)


def _ascii_columns(header: _Header, body: bytes) -> list[NDArray[Any]]:
    places: dict[str, int] = {}
    start = 0
    for field in header.fields:
        places.setdefault(field.name, start)
        start += field.count
    return parse_rows(body, header.num_points, [places[axis] for axis in "xyz"])


def _binary_columns(header: _Header, body: bytes) -> list[NDArray[Any]]:
    _check_length(header, len(body))
    layout = [
        (f"{number}", f"<{field.type}", (field.count,)) for number, field in _numbered(header)
    ]
    points = np.frombuffer(body, np.dtype(layout), header.num_points)
    return [points[f"{_place(header, axis)}"][:, 0] for axis in "xyz"]


def _compressed_columns(header: _Header, body: bytes) -> list[NDArray[Any]]:
    compressed, expanded = struct.unpack_from("<II", body)
    if compressed > len(body) - 8:
        raise ValueError(f"is cut short: {len(body) - 8} of {compressed} compressed bytes")
    content = decompress(body[8 : 8 + compressed], expanded)
    _check_length(header, len(content))
    # Field after field, each for all points.
    columns, start = {}, 0
    for number, field in _numbered(header):
        values = np.frombuffer(content, f"<{field.type}", header.num_points * field.count, start)
        columns[number] = values.reshape(header.num_points, field.count)
        start += field.num_bytes * header.num_points
    return [columns[_place(header, axis)][:, 0] for axis in "xyz"]


_READERS: Final = {
    "ascii": _ascii_columns,
    "binary": _binary_columns,
    "binary_compressed": _compressed_columns,
}


def _numbered(header: _Header) -> list[tuple[int, _Field]]:
    # Names may come twice: that of padding is "_".
    return list(enumerate(header.fields))


def _place(header: _Header, axis: str) -> int:
    return [field.name for field in header.fields].index(axis)


def _check_length(header: _Header, num_bytes: int) -> None:
    expected = header.num_bytes * header.num_points
    if num_bytes < expected:
        raise ValueError(f"is cut short: {num_bytes} of {expected} bytes of points")
