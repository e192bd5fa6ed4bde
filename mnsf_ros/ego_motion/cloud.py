# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A sweep prepared for registration: thinned points, those near the ground last."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.geometry.point_sets import thinned
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

# Points within `_LOW_M` of the lowest one of a column are mostly ground. Ground is smooth, so the
# thinning cells there are larger by the factor `_LOW_CELLS`.
_COLUMN_M: Final = np.float32(1.0)
_LOW_M: Final = np.float32(0.3)
_LOW_CELLS: Final = 1.7


@dataclass(frozen=True, eq=False)
class Cloud:
    """The thinned points of a sweep.

    Attributes:
        points: (N, 3) float32, metres, frame of the sensor.
        num_standing: Number of points not near the ground; they come first.
    """

    points: NDArray[np.float32]
    num_standing: int

    @classmethod
    def of(cls, sweep: Sweep, motion: SweepMotion | None, settings: EgoMotionSettings) -> "Cloud":
        """Returns the cloud of a sweep.

        With a motion, points are corrected for it, as if measured in one moment.
        """
        stride = max(1, -(-len(sweep) // settings.max_points))
        points = sweep.xyz
        if motion is not None and sweep.times_s is not None:
            points, stride = motion.moved(points[::stride], sweep.times_s[::stride]), 1
        parted, number = _standing_first(points, stride, np.float32(settings.max_range_m))
        standing = thinned(parted[:number], settings.thinning_m)
        low = thinned(parted[number:], _LOW_CELLS * settings.thinning_m)
        return cls(np.concatenate([standing, low]), len(standing))

    @property
    def standing(self) -> NDArray[np.float32]:
        """(S, 3) metres, the points that are not near the ground."""
        return self.points[: self.num_standing]

    @property
    def upper(self) -> "Cloud":
        """The cloud without the points near the ground."""
        return Cloud(self.standing, self.num_standing)

    def __len__(self) -> int:
        return len(self.points)


@compiled("Tuple((float32[:, ::1], int64))(float32[:, ::1], int64, float32)")
def _standing_first(
    xyz: NDArray[np.float32], stride: int, max_range_m: np.float32
) -> tuple[NDArray[np.float32], int]:
    """Every n-th point in range, those near the ground last, and the number of the others."""
    width = int(2 * max_range_m / _COLUMN_M) + 2
    lowest = np.full(width * width, np.float32(np.inf))
    rows, columns = np.empty(len(xyz), np.int64), np.empty(len(xyz), np.int64)
    number = 0
    for row in range(0, len(xyz), stride):
        x, y, z = xyz[row, 0], xyz[row, 1], xyz[row, 2]
        if max(abs(x), abs(y), abs(z)) < max_range_m and x * x + y * y < max_range_m * max_range_m:
            column = int((x + max_range_m) / _COLUMN_M) * width + int((y + max_range_m) / _COLUMN_M)
            lowest[column] = min(lowest[column], z)
            rows[number], columns[number] = row, column
            number += 1
    result = np.empty((number, 3), np.float32)
    first, last = 0, number
    for each in range(number):
        row = rows[each]
        if xyz[row, 2] < lowest[columns[each]] + _LOW_M:
            last -= 1
            place = last
        else:
            place = first
            first += 1
        for axis in range(3):
            result[place, axis] = xyz[row, axis]
    return result, first
