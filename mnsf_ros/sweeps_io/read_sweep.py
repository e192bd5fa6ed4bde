# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps in files: npz, npy, PCD, Feather, and binary rows of KITTI and nuScenes; triplets of them.

Every reader raises a SweepFileError if a file is missing, damaged, or has another structure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep, SweepTriplet
from mnsf_ros.sweeps_io.files import array_in, open_npz, read_feather_columns, reading, require

_NUSCENES_ENDING: Final = ".pcd.bin"
_MAX_RING: Final = 127
_USUAL_NAMES: Final = ("xyz", "points", "pc")
# Nanoseconds since 1970 have 19 digits until the year 2286; the first data sets have 18.
_STAMP_DIGITS: Final = (18, 19)
# More columns than lidars measure values: with fewer rows the array is transposed.
_MAX_COLUMNS: Final = 16
_MIN_INTERVAL_S: Final = 0.001
_MAX_INTERVAL_S: Final = 60.0


@dataclass(frozen=True, eq=False)
class SweepInFile:
    """The points (N, 3) of a file in metres, row for row; rows without a point are not finite.

    Without a stamp in the file `stamp_ns` is 0, without a pose `pose` (world_from_sensor) is None.
    """

    xyz: NDArray[np.float32]
    stamp_ns: int = 0
    pose: NDArray[np.float64] | None = None

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(N,) bool, the rows with a finite point."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    def sweep(self) -> Sweep:
        """Returns the measured points as a sweep."""
        xyz = np.ascontiguousarray(self.xyz[self.measured])
        return Sweep(xyz, self.stamp_ns, odometry=self.pose)


def _xyz_of_columns(path: Path, columns: Iterable[NDArray[Any]]) -> NDArray[np.float32]:
    """Stacks columns x, y and z of numbers, (N,) each, to (N, 3) float32.

    Raises:
        SweepFileError: A column does not hold numbers.
    """
    found = list(columns)
    for name, column in zip("xyz", found, strict=True):
        if column.dtype.kind not in "fiu":
            raise SweepFileError(f"{path}: {name} is of {column.dtype}, expected numbers")
    # A value beyond float32 becomes infinite: a row without a point.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([column.astype(np.float32) for column in found], axis=1)


def _xyz_of_table(path: Path, name: str, table: NDArray[Any]) -> NDArray[np.float32]:
    """Returns the first three columns of a table, or its fields x, y and z, as (N, 3) float32.

    Raises:
        SweepFileError: The array is not a table of at least three columns.
    """
    if table.dtype.names is not None:
        return _xyz_of_columns(path, (table[axis].ravel() for axis in "xyz"))
    is_table = table.ndim == 2 and table.shape[1] >= 3
    is_transposed = is_table and table.shape[0] < table.shape[1] > _MAX_COLUMNS
    if not is_table or is_transposed:
        hint = ": one row for each point; is it transposed?" if is_transposed else ""
        raise SweepFileError(
            f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider{hint}"
        )
    return _xyz_of_columns(path, table.T[:3])


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
    return SweepInFile(_xyz_of_table(path, "the table", table))


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
    return SweepInFile(_xyz_of_table(path, "the array", array))


def _read_npz(path: Path, name: str = "") -> SweepInFile:
    """Reads one array of an archive: the one named, a usual one, or the only table.

    `stamp_ns` (an integer) and `pose` (4, 4) beside it belong to the sweep.
    """
    with open_npz(path) as archive:
        wanted = name or next((usual for usual in _USUAL_NAMES if usual in archive.files), "")
        wanted = wanted or _only_table(path, archive)
        xyz = _xyz_of_table(path, f"array {wanted!r}", array_in(archive, wanted))
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
    return SweepInFile(_xyz_of_columns(path, [rows[axis] for axis in "xyz"]))


def _read_feather(path: Path) -> SweepInFile:
    """Reads the columns x, y and z; a name that is a number of nanoseconds is the stamp."""
    xyz = _xyz_of_columns(path, read_feather_columns(path, "xyz").values())
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


def triplet_of_files(
    sweeps: Sequence[SweepInFile], interval_s: float = USUAL_INTERVAL_S
) -> SweepTriplet:
    """Returns the triplet of two sweeps or more in the order of time.

    The last one is the next sweep, the one before it the current one. Poses of these two give the
    ego motion. Unless all sweeps have a stamp, they are `interval_s` apart.

    Raises:
        SweepFileError: There are fewer than two, one has no point, their stamps are out of
            order, the interval is out of range, or a pose cannot be inverted.
    """
    if len(sweeps) < 2:
        raise SweepFileError(f"got {len(sweeps)} sweeps, expected two at least")
    for number, sweep in enumerate(sweeps, start=1):
        if not sweep.measured.any():
            raise SweepFileError(f"sweep {number} of {len(sweeps)} has no finite point")
    stamps = [sweep.stamp_ns for sweep in sweeps]
    if not all(stamps):
        sweeps = _with_stamps(sweeps, interval_s)
    elif stamps != sorted(set(stamps)):
        raise SweepFileError(f"the sweeps are not in the order of time: {stamps} ns")
    *before, current, following = sweeps
    motion = None
    if current.pose is not None and following.pose is not None:
        try:
            motion = np.linalg.inv(following.pose) @ current.pose
        except np.linalg.LinAlgError as error:
            raise SweepFileError(
                f"the pose of the next sweep cannot be inverted: {error}"
            ) from error
    newest_first = [sweep.sweep() for sweep in reversed(before)]
    return SweepTriplet(
        previous=newest_first[0] if newest_first else None,
        current=current.sweep(),
        next=following.sweep(),
        earlier=tuple(newest_first[1:]),
        next_from_current=motion,
    )


def _with_stamps(sweeps: Sequence[SweepInFile], interval_s: float) -> list[SweepInFile]:
    if not _MIN_INTERVAL_S <= interval_s <= _MAX_INTERVAL_S:
        raise SweepFileError(
            f"interval between sweeps: got {interval_s:g} s, expected {_MIN_INTERVAL_S:g} to "
            f"{_MAX_INTERVAL_S:g} s"
        )
    step_ns = round(interval_s * NANOSECONDS)
    return [replace(sweep, stamp_ns=number * step_ns) for number, sweep in enumerate(sweeps, 1)]
