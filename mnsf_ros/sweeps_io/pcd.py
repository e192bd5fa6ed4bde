# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
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
from mnsf_ros.sweeps_io.files import parse_rows, read_bytes, reading
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, xyz_of_columns

_MAX_LITERAL: Final = 32
_LONG_LENGTH: Final = 7
# A reference of 3 bytes stands for at most so many.
_MAX_GROWTH: Final = 264
_KINDS: Final = {"F": "f", "I": "i", "U": "u"}
_TYPES: Final = frozenset({"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"})
_ENCODINGS: Final = ("ascii", "binary", "binary_compressed")
_MAX_HEADER_LINES: Final = 100


def decompress(data: bytes, num_bytes: int) -> bytes:
    """Decompresses a block of the LZF format that gives `num_bytes`.

    Raises:
        ValueError: It gives another number of bytes, or refers to what is not there.
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


@dataclass(frozen=True)
class _Field:
    """One field of the points: `count` values of a NumPy type."""

    name: str
    type: str
    count: int


@dataclass(frozen=True)
class _Header:
    fields: tuple[_Field, ...]
    num_points: int
    encoding: str

    def place(self, axis: str) -> int:
        # Names may come twice: that of padding is "_".
        return [field.name for field in self.fields].index(axis)


def read_pcd(path: Path) -> SweepInFile:
    """Reads the fields x, y and z. The viewpoint in the header is not applied.

    Raises:
        SweepFileError: The file is missing, damaged, cut short, or has no such fields.
    """
    content = read_bytes(path)
    with reading(path):
        header, body = _parse_header(content)
        names = [field.name for field in header.fields]
        if not {"x", "y", "z"} <= set(names):
            raise SweepFileError(f"{path}: has no field x, y, z; it has {', '.join(names)}")
        read_columns = _ascii_columns if header.encoding == "ascii" else _binary_columns
        return SweepInFile(xyz_of_columns(path, read_columns(header, body)))


def _parse_header(content: bytes) -> tuple[_Header, bytes]:
    """The header and what comes after it."""
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
            return _header(entries), content[place:]
    raise ValueError("its header has no line DATA")


def _header(entries: dict[str, list[str]]) -> _Header:
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
    if encoding not in _ENCODINGS:
        raise ValueError(f"its data is {encoding!r}, expected one of {', '.join(_ENCODINGS)}")
    if num_points < 0:
        raise ValueError(f"it has {num_points} points")
    return _Header(tuple(fields), num_points, encoding)


def _ascii_columns(header: _Header, body: bytes) -> list[NDArray[Any]]:
    counts = [field.count for field in header.fields]
    starts = [sum(counts[: header.place(axis)]) for axis in "xyz"]
    return parse_rows(body, header.num_points, starts)


def _binary_columns(header: _Header, body: bytes) -> list[NDArray[Any]]:
    # Point after point, or if compressed field after field, each for all points.
    is_compressed = header.encoding == "binary_compressed"
    if is_compressed:
        compressed, expanded = struct.unpack_from("<II", body)
        if compressed > len(body) - 8:
            raise ValueError(f"is cut short: {len(body) - 8} of {compressed} compressed bytes")
        body = decompress(body[8 : 8 + compressed], expanded)
    sizes = [int(field.type[1:]) * field.count for field in header.fields]
    expected = sum(sizes) * header.num_points
    if len(body) < expected:
        raise ValueError(f"is cut short: {len(body)} of {expected} bytes of points")
    values = np.frombuffer(body, np.uint8, expected)
    columns = []
    for axis in "xyz":
        place = header.place(axis)
        field, start, end = header.fields[place], sum(sizes[:place]), sum(sizes[: place + 1])
        if is_compressed:
            found = values[start * header.num_points : end * header.num_points]
        else:
            found = values.reshape(header.num_points, sum(sizes))[:, start:end]
        column = np.frombuffer(found.tobytes(), f"<{field.type}")
        columns.append(column.reshape(header.num_points, field.count)[:, 0])
    return columns
