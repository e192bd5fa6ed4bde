"""NumPy files with several arrays (.npz), as those of the authors of FNSF and MNSF."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.npy import array_header, checked_array
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
        names = _names(archive)
        wanted = name or next((usual for usual in _USUAL_NAMES if usual in names), "")
        wanted = wanted or _only_table(path, archive)
        xyz = xyz_of_table(path, f"array {wanted!r}", _array(path, archive, wanted))
        stamp_ns = _stamp(path, archive) if "stamp_ns" in names else 0
        pose = _pose(path, archive) if "pose" in names else None
        return SweepInFile(xyz, stamp_ns, pose)


def _names(archive: zipfile.ZipFile) -> list[str]:
    """Names of the arrays; what else is in an archive is not ours."""
    entries = (entry for entry in archive.namelist() if entry.endswith(_SUFFIX))
    return [entry.removesuffix(_SUFFIX) for entry in entries]


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    entry = f"{name}{_SUFFIX}"
    if entry not in archive.namelist():
        names = ", ".join(_names(archive)) or "none"
        raise SweepFileError(f"{path}: has no array {name!r}; it has {names}")
    num_bytes = archive.getinfo(entry).file_size
    if num_bytes > _MAX_BYTES:
        raise SweepFileError(f"{path}: array {name!r} takes {num_bytes} bytes, too many")
    with archive.open(entry) as stream:
        return checked_array(path, stream, num_bytes)


def _only_table(path: Path, archive: zipfile.ZipFile) -> str:
    """Name of the only array that may have points; only the headers are read."""
    tables = []
    for name in _names(archive):
        with archive.open(f"{name}{_SUFFIX}") as stream:
            shape, dtype = array_header(stream)
        if len(shape) == 2 and shape[1] >= 3 and dtype.kind in "fiu":
            tables.append(name)
    if len(tables) != 1:
        found = ", ".join(_names(archive)) or "none"
        raise SweepFileError(
            f"{path}: which array has the points? It has {found}; say it as {path}:NAME"
        )
    return tables[0]


def _stamp(path: Path, archive: zipfile.ZipFile) -> int:
    stamp = _array(path, archive, "stamp_ns")
    if stamp.size != 1 or stamp.dtype.kind not in "iu":
        raise SweepFileError(
            f"{path}: stamp_ns has shape {stamp.shape} of {stamp.dtype}, expected one integer"
        )
    return int(stamp.item())


def _pose(path: Path, archive: zipfile.ZipFile) -> NDArray[np.float64]:
    pose = _array(path, archive, "pose")
    if pose.shape != (4, 4) or pose.dtype.kind not in "fiu":
        raise SweepFileError(
            f"{path}: pose has shape {pose.shape} of {pose.dtype}, expected (4, 4)"
        )
    if not np.isfinite(pose).all():
        raise SweepFileError(f"{path}: pose has values that are not finite")
    return pose.astype(np.float64)
