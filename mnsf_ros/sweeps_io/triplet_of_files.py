"""Sweeps of files, in the order of time, as the triplet of an estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile


def triplet_of_files(sweeps: Sequence[SweepInFile]) -> SweepTriplet:
    """Makes a triplet of sweeps in the order of time.

    Args:
        sweeps: Two or more: the last is the next one, the one before it the current one. If
            these two have poses, they say how the sensor moved.

    Raises:
        SweepFileError: If there are fewer than two, one has no point, their stamps are out of
            order, or a pose cannot be inverted.
    """
    if len(sweeps) < 2:
        raise SweepFileError(f"got {len(sweeps)} sweeps, expected two at least")
    for number, sweep in enumerate(sweeps, start=1):
        if not sweep.measured.any():
            raise SweepFileError(f"sweep {number} of {len(sweeps)} has no finite point")
    stamps = [sweep.stamp_ns for sweep in sweeps]
    if all(stamps) and stamps != sorted(set(stamps)):
        raise SweepFileError(f"the sweeps are not in the order of time: {stamps} ns")
    *before, current, following = sweeps
    newest_first = [sweep.sweep() for sweep in reversed(before)]
    return SweepTriplet(
        previous=newest_first[0] if newest_first else None,
        current=current.sweep(),
        next=following.sweep(),
        earlier=tuple(newest_first[1:]),
        next_from_current=_motion(current, following),
    )


def _motion(current: SweepInFile, following: SweepInFile) -> NDArray[np.float64] | None:
    if current.pose is None or following.pose is None:
        return None
    try:
        motion: NDArray[np.float64] = np.linalg.inv(following.pose) @ current.pose
    except np.linalg.LinAlgError as error:
        raise SweepFileError(f"the pose of the next sweep cannot be inverted: {error}") from error
    return motion
