# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of one sweep in a file: npz, npy or ply. Row i belongs to row i of the sweep's file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_columns import COLOR_NAME, FLOW_NAMES
from mnsf_ros.errors import SweepFileError
from mnsf_ros.setting import SettingValue
from mnsf_ros.sweeps_io.files import check_new_file, new_file

# Arrays of an npz file to their columns.
_VECTORS: Final = {"flow": FLOW_NAMES, "velocity": ("vx", "vy", "vz")}
_PLY_TYPES: Final = {"f": "float", "u": "uchar"}


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

    @property
    def flow(self) -> NDArray[np.float32]:
        """(N, 3) metres until the next sweep, NaN where there is no point."""
        return np.column_stack([self.columns[name] for name in FLOW_NAMES])


def check_target(path: Path, *, overwrite: bool) -> None:
    """Checks before an estimate whether its flow can be written.

    Raises:
        SweepFileError: The ending names no format, the file exists, or its folder is missing.
    """
    if path.suffix.lower() not in WRITERS:
        raise SweepFileError(f"{path}: expected a file that ends with {', '.join(WRITERS)}")
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
        WRITERS[path.suffix.lower()](stream, flow)


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


def _write_npy(stream: IO[bytes], flow: FlowToWrite) -> None:
    np.save(stream, flow.flow)


def _write_ply(stream: IO[bytes], flow: FlowToWrite) -> None:
    columns = dict(zip("xyz", flow.xyz.T, strict=True)) | _with_colors_apart(flow.columns)
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


def _with_colors_apart(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The columns with red, green and blue, as in meshes, instead of packed colours."""
    result = dict(columns)
    packed = np.ascontiguousarray(result.pop(COLOR_NAME), dtype=np.float32).view(np.uint32)
    for name, shift in (("red", 16), ("green", 8), ("blue", 0)):
        result[name] = (packed >> shift).astype(np.uint8)
    return result


WRITERS: Final[Mapping[str, Callable[[IO[bytes], FlowToWrite], None]]] = {
    ".npz": _write_npz,
    ".npy": _write_npy,
    ".ply": _write_ply,
}
