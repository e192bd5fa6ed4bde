# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps as files have them, and triplets of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep, SweepTriplet

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


def xyz_of_columns(path: Path, columns: Iterable[NDArray[Any]]) -> NDArray[np.float32]:
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


def xyz_of_table(path: Path, name: str, table: NDArray[Any]) -> NDArray[np.float32]:
    """Returns the first three columns of a table, or its fields x, y and z, as (N, 3) float32.

    Raises:
        SweepFileError: The array is not a table of at least three columns.
    """
    if table.dtype.names is not None:
        return xyz_of_columns(path, (table[axis].ravel() for axis in "xyz"))
    is_table = table.ndim == 2 and table.shape[1] >= 3
    is_transposed = is_table and table.shape[0] < table.shape[1] > _MAX_COLUMNS
    if not is_table or is_transposed:
        hint = ": one row for each point; is it transposed?" if is_transposed else ""
        raise SweepFileError(
            f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider{hint}"
        )
    return xyz_of_columns(path, table.T[:3])


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
