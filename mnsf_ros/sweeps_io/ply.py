# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""PLY files: ascii, and binary with either byte order."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.files import parse_rows, read_bytes, reading
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, xyz_of_columns

_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2",
    "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_POINTS: Final = "vertex"


@dataclass
class _Element:
    """A table of the file: so many rows of scalars with names."""

    name: str
    num_rows: int
    columns: list[tuple[str, str]] = field(default_factory=list)

    def dtype(self, byte_order: str) -> np.dtype[Any]:
        # By number: the same name may come twice.
        return np.dtype(
            [(f"{place}", f"{byte_order}{kind}") for place, (_, kind) in enumerate(self.columns)]
        )


def read_ply(path: Path) -> SweepInFile:
    """Reads the properties x, y and z of the element vertex.

    Raises:
        SweepFileError: The file is missing, damaged, cut short, or has no such points.
    """
    columns = read_vertices(path)
    if not {"x", "y", "z"} <= columns.keys():
        raise SweepFileError(f"{path}: vertex has no x, y, z; it has {', '.join(columns)}")
    return SweepInFile(xyz_of_columns(path, [columns[axis] for axis in "xyz"]))


def read_vertices(path: Path) -> dict[str, NDArray[Any]]:
    """Reads all properties of the element vertex: name to (N,) values, float64 in ascii files.

    Raises:
        SweepFileError: The file is missing, damaged, cut short, or has no such element.
    """
    content = read_bytes(path)
    with reading(path):
        lines, body = _header_and_body(content)
        byte_order, elements = _parse_header(lines)
        before, points = _points_and_before(elements)
        if byte_order:
            columns = _binary_columns(body, before, points, byte_order)
        else:
            num_lines = sum(element.num_rows for element in before)
            rows = body.split(b"\n", num_lines)[num_lines:]
            columns = parse_rows(b"".join(rows), points.num_rows, range(len(points.columns)))
        # From the last: of two properties with the same name the first counts.
        names = [name for name, _ in points.columns]
        return dict(reversed(list(zip(names, columns, strict=True))))


def _header_and_body(content: bytes) -> tuple[list[list[str]], bytes]:
    """The words of each line of the header, and the bytes after it."""
    end = content.find(b"end_header")
    after = content.find(b"\n", end)
    if not content.startswith(b"ply") or end < 0 or after < 0:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    lines = content[:end].decode("utf-8", errors="replace").splitlines()
    return [line.split() for line in lines], content[after + 1 :]


def _parse_header(lines: list[list[str]]) -> tuple[str, list[_Element]]:
    byte_order: str | None = None
    elements: list[_Element] = []
    for words in lines:
        match words:
            case ["format", name, _]:
                if name not in _BYTE_ORDERS:
                    raise ValueError(f"its format is {name!r}")
                byte_order = _BYTE_ORDERS[name]
            case ["element", name, number]:
                elements.append(_Element(name, int(number)))
                if elements[-1].num_rows < 0:
                    raise ValueError(f"element {name} has {number} rows")
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].columns.append((name, _TYPES[kind]))
            case ["property", "list", *_] if elements:
                elements[-1].columns.append(("list", ""))
            case ["property", *rest]:
                raise ValueError(f"property {' '.join(rest)!r} is of no known type")
    if byte_order is None:
        raise ValueError("its header has no line 'format'")
    return byte_order, elements


def _points_and_before(elements: list[_Element]) -> tuple[list[_Element], _Element]:
    names = [element.name for element in elements]
    if _POINTS not in names:
        raise ValueError(f"it has no element {_POINTS!r}; it has {', '.join(names) or 'none'}")
    number = names.index(_POINTS)
    for element in elements[: number + 1]:
        if ("list", "") in element.columns:
            raise ValueError(f"element {element.name!r} has lists, the points cannot be found")
    return elements[:number], elements[number]


def _binary_columns(
    body: bytes, before: list[_Element], points: _Element, byte_order: str
) -> list[NDArray[Any]]:
    start = sum(element.dtype(byte_order).itemsize * element.num_rows for element in before)
    dtype = points.dtype(byte_order)
    available = max(0, len(body) - start) // max(1, dtype.itemsize)
    if available < points.num_rows:
        raise ValueError(f"is cut short: it has {available} of {points.num_rows} points")
    rows = np.frombuffer(body[start:], dtype, points.num_rows)
    return [rows[f"{place}"] for place in range(len(points.columns))]
