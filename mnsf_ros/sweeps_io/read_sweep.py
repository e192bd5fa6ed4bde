# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps in single files, whatever their format.

Every reader raises a SweepFileError if a file is missing, damaged, or laid out in another way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.arrays import ArrayArchive, open_archive, read_array, read_feather_columns
from mnsf_ros.sweeps_io.files import read_bytes, reading
from mnsf_ros.sweeps_io.pcd import read_pcd
from mnsf_ros.sweeps_io.ply import read_ply
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, xyz_of_columns, xyz_of_table

_NUSCENES_ENDING: Final = ".pcd.bin"
_MAX_RING: Final = 127
_USUAL_NAMES: Final = ("xyz", "points", "pc")
# Nanoseconds since 1970 have 19 digits until the year 2286; the first data sets have 18.
_STAMP_DIGITS: Final = (18, 19)


def read_bin(path: Path) -> SweepInFile:
    """Reads rows of x, y, z and intensity; with the ending .pcd.bin there is a ring, too."""
    content = read_bytes(path)
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
    """Whether each fifth number is the number of a ring, as no coordinate ever is."""
    if len(content) % 20:
        return False
    table = np.frombuffer(content, dtype="<f4").reshape(-1, 5)
    rings, others = table[:, -1], table[:, :3]
    are_rings = np.isin(rings, np.arange(_MAX_RING + 1)).all()
    return bool(are_rings and (others != np.round(others)).any())


def read_npy(path: Path) -> SweepInFile:
    """Reads an array (N, 3) or wider, or one with the named fields x, y and z."""
    content = read_bytes(path)
    with reading(path):
        array = read_array(BytesIO(content), len(content))
        return SweepInFile(xyz_of_table(path, "the array", array))


def read_npz(path: Path, name: str = "") -> SweepInFile:
    """Reads one array of an archive: the one named, a usual one, or the only one that fits.

    `stamp_ns` (an integer) and `pose` (4, 4) beside it belong to the sweep.
    """
    read_bytes(path)
    with reading(path), open_archive(path) as archive:
        wanted = name or next((usual for usual in _USUAL_NAMES if usual in archive.names), "")
        wanted = wanted or _only_table(path, archive)
        xyz = xyz_of_table(path, f"array {wanted!r}", archive.array(wanted))
        stamp_ns = _stamp(archive) if "stamp_ns" in archive.names else 0
        pose = _pose(archive) if "pose" in archive.names else None
        return SweepInFile(xyz, stamp_ns, pose)


def _only_table(path: Path, archive: ArrayArchive) -> str:
    """Name of the only array that may have points; only the headers are read."""
    tables = []
    for name in archive.names:
        shape, dtype = archive.header(name)
        if len(shape) == 2 and shape[1] >= 3 and dtype.kind in "fiu":
            tables.append(name)
    if len(tables) != 1:
        found = ", ".join(archive.names) or "none"
        raise SweepFileError(
            f"{path}: which array has the points? It has {found}; say it as {path}:NAME"
        )
    return tables[0]


def _stamp(archive: ArrayArchive) -> int:
    stamp = archive.array("stamp_ns")
    if stamp.size != 1 or stamp.dtype.kind not in "iu":
        raise ValueError(f"stamp_ns has shape {stamp.shape} of {stamp.dtype}, expected one integer")
    return int(stamp.item())


def _pose(archive: ArrayArchive) -> NDArray[np.float64]:
    pose = archive.array("pose")
    if pose.shape != (4, 4) or pose.dtype.kind not in "fiu":
        raise ValueError(f"pose has shape {pose.shape} of {pose.dtype}, expected (4, 4)")
    if not np.isfinite(pose).all():
        raise ValueError("pose has values that are not finite")
    return pose.astype(np.float64)


def read_feather(path: Path) -> SweepInFile:
    """Reads the columns x, y and z; a name that is a number of nanoseconds is the stamp."""
    read_bytes(path)
    with reading(path):
        xyz = xyz_of_columns(path, read_feather_columns(path, "xyz").values())
        is_stamp = path.stem.isdecimal() and len(path.stem) in _STAMP_DIGITS
        return SweepInFile(xyz, int(path.stem) if is_stamp else 0)


READERS: Final[Mapping[str, Callable[[Path], SweepInFile]]] = {
    ".npz": read_npz,
    ".npy": read_npy,
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".bin": read_bin,
    ".feather": read_feather,
}


def read_sweep(name: str) -> SweepInFile:
    """Reads the sweep in a file, whose ending says the format.

    The name is a path; for one of several arrays in an npz file it is `FILE.npz:ARRAY`.

    Raises:
        SweepFileError: The file is missing or damaged, or of no known format.
    """
    file_name, colon, array = name.rpartition(":")
    if colon and file_name.endswith(".npz"):
        return read_npz(Path(file_name), array)
    path = Path(name)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SweepFileError(f"{path}: expected a file that ends with {', '.join(READERS)}")
    return reader(path)
