# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps in single files: npz, npy, PCD, Feather, and the binary rows of KITTI and nuScenes.

Every reader raises a SweepFileError if a file is missing, damaged, or has another structure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.files import array_in, open_npz, read_feather_columns, reading, require
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, xyz_of_columns, xyz_of_table

_NUSCENES_ENDING: Final = ".pcd.bin"
_MAX_RING: Final = 127
_USUAL_NAMES: Final = ("xyz", "points", "pc")
# Nanoseconds since 1970 have 19 digits until the year 2286; the first data sets have 18.
_STAMP_DIGITS: Final = (18, 19)


def _read_bin(path: Path) -> SweepInFile:
    """Reads rows of x, y, z and intensity; with the ending .pcd.bin also a ring."""
    content = path.read_bytes()
    is_nuscenes = path.name.lower().endswith(_NUSCENES_ENDING)
    if not is_nuscenes and _has_rings(content):
        raise SweepFileError(
            f"{path}: its rows are x, y, z, intensity and ring, as those of nuScenes: let its name "
            f"end with {_NUSCENES_ENDING}"
        )
    num_columns = 5 if is_nuscenes else 4
    if len(content) % (4 * num_columns):
        raise SweepFileError(
            f"{path}: has {len(content)} bytes, expected rows of {num_columns} float32, a multiple "
            f"of {4 * num_columns}"
        )
    table = np.frombuffer(content, dtype="<f4").reshape(-1, num_columns)
    return SweepInFile(xyz_of_table(path, "the table", table))


def _has_rings(content: bytes) -> bool:
    """Whether each fifth number is a ring number, as no coordinate ever is."""
    if len(content) % 20:
        return False
    table = np.frombuffer(content, dtype="<f4").reshape(-1, 5)
    rings, others = table[:, -1], table[:, :3]
    are_rings = np.isin(rings, np.arange(_MAX_RING + 1)).all()
    return bool(are_rings and (others != np.round(others)).any())


def _read_npy(path: Path) -> SweepInFile:
    """Reads an array (N, 3) or wider, or one with the named fields x, y and z."""
    with path.open("rb") as file:
        array = np.lib.format.read_array(file, allow_pickle=False)  # type: ignore[no-untyped-call]
    return SweepInFile(xyz_of_table(path, "the array", array))


def _read_npz(path: Path, name: str = "") -> SweepInFile:
    """Reads one array of an archive: the one named, a usual one, or the only table.

    `stamp_ns` (an integer) and `pose` (4, 4) beside it belong to the sweep.
    """
    with open_npz(path) as archive:
        wanted = name or next((usual for usual in _USUAL_NAMES if usual in archive.files), "")
        wanted = wanted or _only_table(path, archive)
        xyz = xyz_of_table(path, f"array {wanted!r}", array_in(archive, wanted))
        stamp_ns = _stamp(archive["stamp_ns"]) if "stamp_ns" in archive.files else 0
        pose = _pose(archive["pose"]) if "pose" in archive.files else None
        return SweepInFile(xyz, stamp_ns, pose)


def _only_table(path: Path, archive: NpzFile) -> str:
    """Returns the name of the only array that can hold points."""
    tables = [name for name in archive.files if _is_table(archive, name)]
    if len(tables) != 1:
        found = ", ".join(archive.files) or "none"
        raise SweepFileError(
            f"{path}: which array has the points? It has {found}; name one as {path}:NAME"
        )
    return tables[0]


def _is_table(archive: NpzFile, name: str) -> bool:
    try:
        array = archive[name]
    except ValueError:  # an array of Python objects
        return False
    is_array = isinstance(array, np.ndarray)  # other files of the archive are bytes
    return is_array and array.ndim == 2 and array.shape[1] >= 3 and array.dtype.kind in "fiu"


def _stamp(stamp: NDArray[Any]) -> int:
    if stamp.size != 1 or stamp.dtype.kind not in "iu":
        raise ValueError(f"stamp_ns has shape {stamp.shape} of {stamp.dtype}, expected one integer")
    return int(stamp.item())


def _pose(pose: NDArray[Any]) -> NDArray[np.float64]:
    if pose.shape != (4, 4) or pose.dtype.kind not in "fiu":
        raise ValueError(f"pose has shape {pose.shape} of {pose.dtype}, expected (4, 4)")
    if not np.isfinite(pose).all():
        raise ValueError("pose has values that are not finite")
    return pose.astype(np.float64)


def _read_pcd(path: Path) -> SweepInFile:
    """Reads the fields x, y and z of a PCD file; the viewpoint in its header is not applied."""
    cloud = require("pypcd4").PointCloud.from_path(path)
    missing = [axis for axis in "xyz" if axis not in cloud.fields]
    if missing:
        raise ValueError(f"has no field {', '.join(missing)}; it has {', '.join(cloud.fields)}")
    # The library takes fewer whole points without a word.
    rows = np.atleast_1d(cloud.pc_data)
    if len(rows) != cloud.points:
        raise ValueError(f"is cut short: it has {len(rows)} of {cloud.points} points")
    return SweepInFile(xyz_of_columns(path, [rows[axis] for axis in "xyz"]))


def _read_feather(path: Path) -> SweepInFile:
    """Reads the columns x, y and z; a name that is a number of nanoseconds is the stamp."""
    xyz = xyz_of_columns(path, read_feather_columns(path, "xyz").values())
    is_stamp = path.stem.isdecimal() and len(path.stem) in _STAMP_DIGITS
    return SweepInFile(xyz, int(path.stem) if is_stamp else 0)


_READERS: Final[Mapping[str, Callable[[Path], SweepInFile]]] = {
    ".npz": _read_npz,
    ".npy": _read_npy,
    ".pcd": _read_pcd,
    ".bin": _read_bin,
    ".feather": _read_feather,
}
ENDINGS: Final = tuple(_READERS)


def read_sweep(name: str) -> SweepInFile:
    """Reads the sweep in a file, whose ending tells the format.

    The name is a path; for one of several arrays in an npz file it is `FILE.npz:ARRAY`.

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
        if path.is_file() and path.stat().st_size == 0:
            raise SweepFileError(f"{path}: is empty")
        return _read_npz(path, array) if has_array else reader(path)
