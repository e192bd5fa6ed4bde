"""Binary PLY files with one element of scalars, as lidar sweeps are stored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.source_files import reading

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

_TYPES: Final = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS: Final = {"binary_little_endian": "<", "binary_big_endian": ">"}
_END: Final = b"end_header\n"


def read_ply_points(path: Path) -> NDArray[Any]:
    """Returns the vertices as a structured array of one row each.

    Raises:
        DatasetError: If the file is missing, cut short, or another kind of PLY.
    """
    with reading(path):
        raw = path.read_bytes()
        # Files written on other systems may end the lines of the header in another way.
        start = raw.find(_END) + len(_END)
        if not raw.startswith(b"ply") or start < len(_END):
            raise ValueError("is no PLY file with lines that end in \\n")
        dtype, count = _layout(raw[:start].decode("ascii").splitlines())
        available = (len(raw) - start) // dtype.itemsize
        if available < count:
            raise DatasetError(f"{path}: is cut short: it has {available} of {count} points")
        return np.frombuffer(raw, dtype, count, start)


def _layout(header: list[str]) -> tuple[np.dtype[Any], int]:
    byte_order, count, fields = "", -1, []
    for line in header:
        words = line.split()
        if words[:1] == ["format"]:
            if words[1] not in _BYTE_ORDERS:
                raise ValueError(f"its format is {words[1]!r}, expected {', '.join(_BYTE_ORDERS)}")
            byte_order = _BYTE_ORDERS[words[1]]
        elif words[:1] == ["element"]:
            if count >= 0:
                break  # only the first element is read
            if words[1] != "vertex":
                raise ValueError(f"its first element is {words[1]!r}, expected 'vertex'")
            count = int(words[2])
        elif words[:1] == ["property"]:
            if words[1] not in _TYPES:
                raise ValueError(f"property of type {words[1]!r}, expected a number")
            fields.append((words[2], byte_order + _TYPES[words[1]]))
    if count < 0 or not fields or not byte_order:
        raise ValueError("its header lacks a format, an element or properties")
    return np.dtype(fields), count
