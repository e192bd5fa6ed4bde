# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A sweep prepared for registration: thinned points in parts, each measured at about one time."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats, Floats32, Ints32
from mnsf_ros.compiled import compiled
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.geometry.point_grid import PointGrid
from mnsf_ros.geometry.point_sets import thinned
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

# Points within `_LOW_M` of the lowest one of a column are mostly ground. Ground is smooth, so the
# thinning cells there are larger by the factor `_LOW_CELLS`.
_COLUMN_M: Final = np.float32(1.0)
_LOW_M: Final = np.float32(0.3)
_LOW_CELLS: Final = 1.7
# Seen from above, heights count by this share: between two lasers on a wall is wall, too.
HEIGHT_SHARE: Final = np.float32(0.1)
# While the sensor turns by 10 degrees/s more than expected, a point 30 m away moves by 3 cm in a
# part of a usual sweep, less than the noise of registration.
_NUM_PARTS: Final = 20


@dataclass(frozen=True, eq=False)
class Cloud:
    """The thinned points of a sweep.

    Attributes:
        points: (N, 3) float32, metres, frame of the sensor.
        num_standing: Number of points not near the ground; they come first.
        parts: (N,) int32, the part of the sweep that each point belongs to.
        part_times_s: (K,) seconds from the moment that points are corrected to, to each part; a
            single zero if the sweep counts as taken in one moment.
        beam_axis: (3,) unit vector, the axis that the beams turn about.
    """

    points: Floats32
    num_standing: int
    parts: Ints32
    part_times_s: Floats
    beam_axis: Floats

    @classmethod
    def of(cls, sweep: Sweep, motion: SweepMotion | None, settings: EgoMotionSettings) -> "Cloud":
        """Returns the cloud of a sweep.

        With a motion, points are corrected for it, as if measured in one moment.
        """
        stride = max(1, -(-len(sweep) // settings.max_points))
        points = sweep.xyz
        if motion is not None and sweep.times_s is not None:
            times_s = sweep.times_s[::stride]
            moved = motion.moved(points[::stride], times_s)
            points, stride = np.column_stack([moved, times_s - np.float32(motion.moment_s)]), 1
        sorted_, number = _standing_first(points, stride, np.float32(settings.max_range_m))
        standing = thinned(sorted_[:number], settings.thinning_m)
        low = thinned(sorted_[number:], _LOW_CELLS * settings.thinning_m)
        columns = np.concatenate([standing, low])
        parts, axis = _parts(columns[:, 3:]), sweep.beams_from_sensor[2]
        return cls(np.ascontiguousarray(columns[:, :3]), len(standing), *parts, axis)

    def at_once(self, points: Floats32) -> "Cloud":
        """Returns a cloud of points (N, 3) of this one, as if measured in one moment."""
        return Cloud(points, len(points), *_parts(points[:, 3:]), self.beam_axis)

    @cached_property
    def from_above(self) -> PointGrid:
        """The points with less height, to be compared from above."""
        points = self.points.copy()
        points[:, 2] *= HEIGHT_SHARE
        return PointGrid(points)

    def poses(self, pose: Floats, velocity: Floats) -> Floats:
        """Returns (K, 4, 4) the poses of the sensor at the times of the parts.

        Args:
            pose: (4, 4) world_from_sensor at the moment.
            velocity: (6,) on top of the motion that points were corrected for, in the axes of the
                world, m/s and rad/s.
        """
        if len(self.part_times_s) == 1:
            return pose[None]
        moved = self.part_times_s[:, None] * velocity
        poses = np.repeat(pose[None], len(moved), axis=0)
        poses[:, :3, :3] = Rotation.from_rotvec(moved[:, 3:]).as_matrix() @ pose[:3, :3]
        poses[:, :3, 3] += moved[:, :3]
        return poses

    @property
    def upper(self) -> "Cloud":
        """The points that are not near the ground, as if measured in one moment."""
        return self.at_once(self.points[: self.num_standing])

    def __len__(self) -> int:
        return len(self.points)


def _parts(times_s: Floats32) -> tuple[Ints32, Floats]:
    """The part of each point, and the times of the parts, by the times (N, 1); (N, 0) for none."""
    if times_s.size == 0:
        return np.zeros(len(times_s), np.int32), np.zeros(1)
    edges = np.linspace(times_s.min(), times_s.max(), _NUM_PARTS + 1)
    parts = np.searchsorted(edges[1:-1], times_s[:, 0]).astype(np.int32)
    return parts, (edges[1:] + edges[:-1]) / 2


@compiled("Tuple((float32[:, ::1], int64))(float32[:, ::1], int64, float32)")
def _standing_first(xyz: Floats32, stride: int, max_range_m: np.float32) -> tuple[Floats32, int]:
    """Every n-th row with a point in range, near the ground last, and the number of the others."""
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
    result = np.empty((number, xyz.shape[1]), np.float32)
    first, last = 0, number
    for each in range(number):
        row = rows[each]
        if xyz[row, 2] < lowest[columns[each]] + _LOW_M:
            last -= 1
            place = last
        else:
            place = first
            first += 1
        for axis in range(xyz.shape[1]):
            result[place, axis] = xyz[row, axis]
    return result, first
