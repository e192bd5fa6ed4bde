# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps and their flow in files. Row i of the flow belongs to row i of the sweep's file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.setting import SettingValue
from mnsf_ros.sweeps_io.files import array_in, check_new_file, new_file, open_npz, reading, require
from mnsf_ros.sweeps_io.flow_columns import COLOR_NAME, FLOW_NAMES

# Arrays of an npz file to their columns.
_VECTORS: Final = {"flow": FLOW_NAMES, "velocity": ("vx", "vy", "vz")}
_PLY_TYPES: Final = {"f": "float", "u": "uchar"}


def read_points(name: str) -> NDArray[np.float32]:
    """Reads the points (N, 3) of a sweep, metres; rows without a point are not finite.

    The ending of the name tells the format. For another array than `xyz` of an npz file it is
    `FILE.npz:ARRAY`.

    Raises:
        SweepFileError: The file is missing or damaged, or of no known format.
    """
    file_name, colon, array = name.rpartition(":")
    has_array = bool(colon) and file_name.endswith(".npz")
    path = Path(file_name if has_array else name)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise SweepFileError(f"{path}: expected a file that ends with {', '.join(_READERS)}")
    with reading(path):
        columns = list(_read_npz(path, array) if has_array else reader(path))
        for axis, column in zip("xyz", columns, strict=True):
            if column.dtype.kind not in "fiu":
                raise ValueError(f"{axis} is of {column.dtype}, expected numbers")
        # A value beyond float32 becomes infinite: a row without a point.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([column.astype(np.float32) for column in columns], axis=1)


# x, y and z, (N,) each.
_Columns = Iterable[NDArray[Any]]


def _columns_of(table: NDArray[Any]) -> _Columns:
    """The first three columns of a table."""
    if table.ndim != 2 or table.shape[1] < 3:
        raise ValueError(f"has shape {table.shape}, expected (N, 3) or wider")
    return table.T[:3]


def _read_npy(path: Path) -> _Columns:
    with path.open("rb") as file:
        array = np.lib.format.read_array(file, allow_pickle=False)  # type: ignore[no-untyped-call]
    return _columns_of(array)


def _read_npz(path: Path, name: str = "xyz") -> _Columns:
    with open_npz(path) as archive:
        return _columns_of(array_in(archive, name))


def _read_bin(path: Path) -> _Columns:
    """Rows of x, y, z and intensity (KITTI); with the ending .pcd.bin also a ring (nuScenes)."""
    num_columns = 5 if path.name.lower().endswith(".pcd.bin") else 4
    return _columns_of(np.frombuffer(path.read_bytes(), dtype="<f4").reshape(-1, num_columns))


def _read_pcd(path: Path) -> _Columns:
    """The viewpoint in the header is not applied."""
    cloud = require("pypcd4").PointCloud.from_path(path)
    # The library takes fewer whole points without a word.
    rows = np.atleast_1d(cloud.pc_data)
    if len(rows) != cloud.points:
        raise ValueError(f"is cut short: it has {len(rows)} of {cloud.points} points")
    return [rows[axis] for axis in "xyz"]


_READERS: Final[Mapping[str, Callable[[Path], _Columns]]] = {
    ".npz": _read_npz,
    ".npy": _read_npy,
    ".pcd": _read_pcd,
    ".bin": _read_bin,
}


@dataclass(frozen=True, eq=False)
class FlowToWrite:
    """Flow of the N points of the current sweep, row for row.

    Attributes:
        xyz: (N, 3) metres.
        kept: (N,) points inside the crop that are not ground.
        columns: Columns of `flow_columns` that the method gives, by name, (N,) each; with the flow.
        method: Name of the method.
        settings: Its settings, by full name.
    """

    xyz: NDArray[np.float32]
    kept: NDArray[np.bool_]
    columns: Mapping[str, NDArray[Any]]
    method: str = ""
    settings: Mapping[str, SettingValue] = field(default_factory=dict)


def check_target(path: Path, *, overwrite: bool) -> None:
    """Checks before an estimate whether its flow can be written.

    Raises:
        SweepFileError: The ending names no format, the file exists, or its folder is missing.
    """
    if path.suffix.lower() not in _WRITERS:
        raise SweepFileError(f"{path}: expected a file that ends with {', '.join(_WRITERS)}")
    check_new_file(path, SweepFileError, overwrite=overwrite)


def write_flow(path: Path, flow: FlowToWrite, *, overwrite: bool = False) -> None:
    """Writes the file complete, or not at all.

    Raises:
        SweepFileError: It cannot be written, or the file exists.
    """
    check_target(path, overwrite=overwrite)
    with (
        new_file(path, SweepFileError, overwrite=overwrite) as draft,
        draft.open("xb") as stream,
    ):
        _WRITERS[path.suffix.lower()](stream, flow)


def _write_npz(stream: IO[bytes], flow: FlowToWrite) -> None:
    apart = {COLOR_NAME, *chain.from_iterable(_VECTORS.values())}
    arrays: dict[str, Any] = {
        "xyz": flow.xyz,
        "kept": flow.kept,
        "method": np.array(flow.method),
        "settings": np.array(json.dumps(dict(flow.settings))),
        **{name: values for name, values in flow.columns.items() if name not in apart},
    }
    for name, parts in _VECTORS.items():
        if parts[0] in flow.columns:
            arrays[name] = np.column_stack([flow.columns[part] for part in parts])
    np.savez_compressed(stream, **arrays)


def _write_ply(stream: IO[bytes], flow: FlowToWrite) -> None:
    columns = dict(zip("xyz", flow.xyz.T, strict=True)) | dict(flow.columns)
    # Red, green and blue, as in meshes, instead of packed colours.
    packed = np.ascontiguousarray(columns.pop(COLOR_NAME), dtype=np.float32).view(np.uint32)
    for name, shift in (("red", 16), ("green", 8), ("blue", 0)):
        columns[name] = (packed >> shift).astype(np.uint8)
    kinds = [(name, values.dtype.newbyteorder("<")) for name, values in columns.items()]
    table = np.empty(len(flow.xyz), dtype=kinds)
    for name, values in columns.items():
        table[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment flow of {flow.method}: metres until the next sweep",
        f"element vertex {len(flow.xyz)}",
        *(f"property {_PLY_TYPES[values.dtype.kind]} {name}" for name, values in columns.items()),
        "end_header\n",
    ]
    stream.write("\n".join(header).encode())
    stream.write(table.tobytes())


_WRITERS: Final[Mapping[str, Callable[[IO[bytes], FlowToWrite], None]]] = {
    ".npz": _write_npz,
    ".ply": _write_ply,
}
