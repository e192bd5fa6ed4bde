# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The mounting of a stream's sweeps: by parameters, or by the ground that they show."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.point_sets import chosen_points, thinned
from mnsf_ros.geometry.transforms import mounted_at, sensor_mount
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting import Mounting
from mnsf_ros.sweeps.sweep import Sweep

# Ground farther out is at another height, or hardly seen.
_REACH_M: Final = 30.0
_CELL_M: Final = 0.5
_MAX_POINTS: Final = 3000
# Of fewer, chance puts a tenth on a plane.
_MIN_POINTS: Final = 300
# With a fifth of the points on the ground, four of so many planes are the ground's.
_NUM_PLANES: Final = 500
_TOLERANCE_M: Final = 0.15
# Share of points beyond the ground: mirrored by wet roads, or on a slope.
_MAX_BEYOND: Final = 0.05
# Nearer to the ground the origin is hardly the lens.
_MIN_HEIGHT_M: Final = 0.5
# Share of points on the ground: .15 to .97 in 42 sweeps of five lidars and of simulated worlds, and
# less than .1 in a canyon of houses; on other planes of no more than 60 degrees less than .06.
_MIN_SHARE: Final = 0.1
# Up to here methods are as good as on level ground, by simulated streets.
_MAX_TILT_DEG: Final = 30.0
# Planes steeper than this may be walls: only parameters or TF know of such a tilt.
_MIN_WALL_DEG: Final = 65.0
# The lens of a lidar is higher above the ground.
_MIN_LENS_M: Final = 0.2


class MountingEstimate:
    """The mounting of a stream's sweeps: by parameters, else as they tell it, else by the ground.

    Attributes:
        text: In words.
        fault: What the user should mend; empty if there is nothing.
    """

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._forget()

    def _forget(self) -> None:
        self.text, self.fault = "unknown: no cloud yet", ""
        self._found: Mounting | None = None
        self._is_given = False
        self._num_sweeps = 0

    def mounted(self, sweep: Sweep, settings: Settings) -> Sweep:
        """Returns the next sweep with its mounting, if that is known.

        What the first sweep shows is kept while frame and parameters stay.
        """
        key = sweep.frame_id, settings.lidars, settings.lidar_1, settings.ego_motion
        if key != self._key:
            self._forget()
            self._key = key
            self._found = _by_parameters(settings, sweep.frame_id)
            self._is_given = self._found is not None
        if sweep.mounting is not None and not self._is_given:
            self._found, self.fault = sweep.mounting, ""
        elif self._found is None:
            self._num_sweeps += 1
            # Looked for again at the sweeps 2, 4, 8 ...: each look takes some 10 ms.
            if self._num_sweeps & (self._num_sweeps - 1) == 0:
                self._look(sweep)
        self.text = str(self._found or "unknown: no ground is seen")
        if self._found is None:
            return sweep
        is_same = self._found is sweep.mounting or self._found.is_level
        return sweep if is_same else replace(sweep, mounting=self._found)

    def _look(self, sweep: Sweep) -> None:
        """Estimates the mounting by the ground."""
        ground = ground_of(sweep.xyz)
        if ground is None:
            return
        self._found = Mounting.of(ground[:3], np.zeros(3), "estimated from the ground")
        if ground[3] < _MIN_LENS_M:
            self.fault = (
                f"the origin of the frame {sweep.frame_id!r} is {ground[3]:.1f} m above the "
                "ground, so it is not at the lidar: set lidars.frame to this frame, and "
                "lidar_1.x_m to lidar_1.z_m to the place of the lidar in it"
            )


def is_levelled(tilt_deg: float, settings: Settings) -> bool:
    """Whether methods get the clouds of a sensor with this tilt upright."""
    known, mount = settings.lidar_1, settings.ego_motion
    is_given = any((known.roll_deg, known.pitch_deg, mount.sensor_roll_deg, mount.sensor_pitch_deg))
    is_wall = _MIN_WALL_DEG < tilt_deg < 180.0 - _MIN_WALL_DEG
    return is_given or (tilt_deg > _MAX_TILT_DEG and not is_wall)


def _by_parameters(settings: Settings, frame_id: str) -> Mounting | None:
    """The mounting of one lidar by its parameters; None if they say nothing about it."""
    if settings.lidars.count > 1:
        return None
    pose, is_given = mounted_at(settings.lidar_1), settings.lidars.poses == "parameters"
    if frame_id == settings.lidars.frame:
        lens_m, up = pose[:3, 3], np.array([0.0, 0.0, 1.0])
    else:
        lens_m = np.zeros(3)
        mounts = (pose, sensor_mount(settings.ego_motion))
        # The third row of a rotation is z of the level frame, in the axes of the sensor.
        up = next((own[2, :3] for own in mounts if own[2, 2] < 1.0), pose[2, :3])
    mounting = Mounting.of(up, lens_m, "by parameters")
    return mounting if is_given or not mounting.is_level else None


def ground_of(xyz: NDArray[np.float32]) -> NDArray[np.float64] | None:
    """Returns (4,) n, h of the ground under points (N, 3), so that n x + h is a height above it.

    The ground is the plane with most points that has nearly none beyond it. Its normal is exactly z
    where the frame is level enough for all methods. None if no ground is seen.
    """
    planes = _planes_of(xyz)
    if planes is None:
        return None
    normals, heights, shares = planes
    tilts_deg = np.degrees(np.arccos(np.clip(normals[:, 2], -1.0, 1.0)))
    level_shares = np.where(tilts_deg <= _MAX_TILT_DEG, shares, 0.0)
    level, best = np.argmax(level_shares), np.argmax(shares)
    if shares[best] < _MIN_SHARE:
        return None
    # Between floor and ceiling, the frame is taken as it is.
    if 2 * level_shares[level] > shares[best]:
        return np.array([0.0, 0.0, 1.0, heights[level]])
    if _MIN_WALL_DEG < tilts_deg[best] < 180.0 - _MIN_WALL_DEG:
        return None
    return np.append(normals[best], heights[best])


def _planes_of(
    xyz: NDArray[np.float32],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
    """Random planes through points (N, 3), metres.

    Returns:
        (K, 3) normals, upwards if they are ground; (K,) height of the origin above each; and (K,)
        share of the points on it, 0 unless it bounds the others. None without enough points.
    """
    near = np.einsum("ij,ij->i", xyz, xyz) < _REACH_M**2
    points = thinned(chosen_points(xyz, near), _CELL_M).astype(np.float64)
    if len(points) < _MIN_POINTS:
        return None
    random = np.random.default_rng(0)
    points = points[random.permutation(len(points))[:_MAX_POINTS]]
    first, second, third = points[random.integers(0, len(points), (3, _NUM_PLANES))]
    normals = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normals, axis=1)
    normals, first = normals[lengths > _CELL_M], first[lengths > _CELL_M]
    normals /= lengths[lengths > _CELL_M, None]
    offsets = np.sum(first * normals, axis=1)
    heights = points @ normals.T - offsets
    above, below = (np.mean(side * heights > 2 * _TOLERANCE_M, axis=0) for side in (1, -1))
    # Of an empty plain the side that the sensor is on is up.
    is_plain = np.maximum(above, below) < _MAX_BEYOND
    is_down = np.where(is_plain & (np.abs(offsets) > _MIN_HEIGHT_M), offsets > 0, below > above)
    is_bound = np.minimum(above, below) < _MAX_BEYOND
    shares = is_bound * np.mean(np.abs(heights) < _TOLERANCE_M, axis=0)
    sides = np.where(is_down, -1.0, 1.0)
    return sides[:, None] * normals, -sides * offsets, shares
