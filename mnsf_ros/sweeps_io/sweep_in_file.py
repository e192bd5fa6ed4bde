"""What a file says about one sweep, and the one error for all files that do not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.damaged_files import UNREADABLE, reason

# More than lidars measure of a point; that many columns and fewer rows are points side by side.
_MAX_COLUMNS: Final = 16


@dataclass(frozen=True, eq=False)
class SweepInFile:
    """The points of a file, row for row, before anything is left out.

    Attributes:
        xyz: (N, 3) float32, metres; rows without a measurement are not finite.
        stamp_ns: Time of the sweep, integer nanoseconds; 0 where the file does not say.
        pose: (4, 4) from the sensor to the world; None where the file does not say.
    """

    xyz: NDArray[np.float32]
    stamp_ns: int = 0
    pose: NDArray[np.float64] | None = None

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(N,) bool, the rows with a finite point."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    def sweep(self) -> Sweep:
        """The measured points as a sweep."""
        xyz = np.ascontiguousarray(self.xyz[self.measured])
        return Sweep(xyz, self.stamp_ns, odometry=self.pose)


def xyz_of_columns(path: Path, columns: list[NDArray[Any]]) -> NDArray[np.float32]:
    """Puts three columns of numbers, (N,) each, side by side as (N, 3) float32.

    Raises:
        SweepFileError: If a column does not hold numbers.
    """
    for name, column in zip("xyz", columns, strict=True):
        if column.dtype.kind not in "fiu":
            raise SweepFileError(f"{path}: {name} is of {column.dtype}, expected numbers")
    # Beyond float32 it becomes infinity: a row without a measurement.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([column.astype(np.float32) for column in columns], axis=1)


def xyz_of_table(path: Path, name: str, table: NDArray[Any]) -> NDArray[np.float32]:
    """The first three columns of an array with at least three, (N, 3) float32.

    An array of rows with named fields has to name x, y and z.

    Raises:
        SweepFileError: If the array is not of that kind.
    """
    if table.dtype.names is not None:
        return xyz_of_columns(path, [table[axis].ravel() for axis in "xyz"])
    if table.ndim != 2 or table.shape[1] < 3:
        raise SweepFileError(f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider")
    if table.shape[0] < table.shape[1] > _MAX_COLUMNS:
        raise SweepFileError(
            f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider: one row for each "
            "point; is it transposed?"
        )
    return xyz_of_columns(path, [table[:, axis] for axis in range(3)])


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turns what parsers raise inside the block into a SweepFileError that names the file."""
    try:
        yield
    except UNREADABLE as error:
        raise SweepFileError(f"{path}: cannot be read: {reason(error)}") from error


def read_bytes(path: Path) -> bytes:
    """The content of a file.

    Raises:
        SweepFileError: If there is none, or it is empty.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        # A named pipe would keep us waiting for ever.
        raise SweepFileError(f"{path}: is not a regular file")
    with reading(path):
        content = path.read_bytes()
    if not content:
        raise SweepFileError(f"{path}: is empty")
    return content
