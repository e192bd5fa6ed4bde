"""NumPy files with several arrays (.npz), as those of the authors of FNSF and MNSF."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.npy import checked_array
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, read_bytes, reading, xyz_of_table

_USUAL_NAMES: Final = ("xyz", "points", "pc")
_SUFFIX: Final = ".npy"
# More than any sweep; a damaged archive may claim to grow to anything.
_MAX_BYTES: Final = 2**31


def read_npz(path: Path, name: str = "") -> SweepInFile:
    """Reads one array of an archive: the one named, a usual one, or the only one that fits.

    `stamp_ns` (an integer) and `pose` (4, 4) beside it belong to the sweep.

    Args:
        path: The archive.
        name: Name of the array; may be left empty.

    Raises:
        SweepFileError: If the file is missing or damaged, has no such array, or several that fit.
    """
    read_bytes(path)
    with reading(path), zipfile.ZipFile(path) as archive:
        names = [entry.removesuffix(_SUFFIX) for entry in archive.namelist()]
        wanted = name or next((usual for usual in _USUAL_NAMES if usual in names), "")
        if wanted:
            table = _array(path, archive, wanted)
        else:
            wanted, table = _only_table(path, archive, names)
        xyz = xyz_of_table(path, f"array {wanted!r}", table)
        stamp = _array(path, archive, "stamp_ns") if "stamp_ns" in names else np.array(0)
        pose = _array(path, archive, "pose") if "pose" in names else None
        return SweepInFile(xyz, int(stamp), None if pose is None else _checked_pose(path, pose))


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    entry = f"{name}{_SUFFIX}"
    if entry not in archive.namelist():
        names = ", ".join(each.removesuffix(_SUFFIX) for each in archive.namelist())
        raise SweepFileError(f"{path}: has no array {name!r}; it has {names or 'none'}")
    num_bytes = archive.getinfo(entry).file_size
    if num_bytes > _MAX_BYTES:
        raise SweepFileError(f"{path}: array {name!r} takes {num_bytes} bytes, too many")
    with archive.open(entry) as stream:
        return checked_array(path, stream, num_bytes)


def _only_table(path: Path, archive: zipfile.ZipFile, names: list[str]) -> tuple[str, NDArray[Any]]:
    arrays = {name: _array(path, archive, name) for name in names}
    tables = [name for name, array in arrays.items() if array.ndim == 2 and array.shape[1] >= 3]
    if len(tables) != 1:
        found = ", ".join(names) or "none"
        raise SweepFileError(
            f"{path}: which array has the points? It has {found}; say it as {path}:NAME"
        )
    return tables[0], arrays[tables[0]]


def _checked_pose(path: Path, pose: NDArray[Any]) -> NDArray[np.float64]:
    if pose.shape != (4, 4) or pose.dtype.kind not in "fiu":
        raise SweepFileError(
            f"{path}: pose has shape {pose.shape} of {pose.dtype}, expected (4, 4)"
        )
    return pose.astype(np.float64)
