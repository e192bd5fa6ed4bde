# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The mounting of a stream's sweeps: by parameters, or by ground and beams."""

from dataclasses import replace
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.geometry.point_sets import chosen_points, thinned
from mnsf_ros.geometry.transforms import mounted_at, sensor_mount
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.beam_cones import BeamCones
from mnsf_ros.sweeps.mounting import Mounting, tilt_deg
from mnsf_ros.sweeps.sweep import Sweep

_UP: Final = np.array([0.0, 0.0, 1.0])
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
# Up to 5 degrees methods are as good as on level ground, by simulated streets; a lidar that is
# tilted by 12 and not levelled costs one of six a quarter to nine tenths of its movers.
_MAX_TILT_DEG: Final = 6.0
# Few lidars are tilted more.
_USUAL_TILT_DEG: Final = 30.0
# A floor is no more than so many times farther away than the wall of a corridor; a house front that
# is level in the frame of a lidar on its side is.
_TIMES_FARTHER: Final = 4.0
# Mounts along an axis are exact: the ground is known to a degree only.
_NEARLY: Final = np.cos(np.radians(3.0))
# Planes steeper than this may be walls: only parameters or TF know of such a tilt.
_MIN_WALL_DEG: Final = 65.0


class MountingEstimate:
    """The mounting of a stream's sweeps: by parameters, else as they tell it, else by their points.

    Attributes:
        found: The mounting; None if unknown.
        ground: (4,) n, h, so that n x + h is the height of x above the ground; None if it was not
            looked for, or not seen. Without a mounting it may be a wall.
        cones: The beams; None if they were not looked at, or are unknown.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Starts anew."""
        self._key: tuple[object, ...] = ()
        self.found: Mounting | None = None
        self.ground: Floats | None = None
        self.cones: BeamCones | None = None
        self._is_given = False
        self._num_sweeps = 0

    @property
    def text(self) -> str:
        """Tilt, lens, source and height, in words."""
        if self.ground is None and self.found is None:
            return f"unknown: no {'ground is seen' if self._num_sweeps else 'cloud yet'}"
        if self.ground is None:
            return str(self.found)
        if self.found is None:
            return "unknown: what may be ground may be a wall"
        height = f"{abs(self.ground[3]):.2f} m {'above' if self.ground[3] > 0 else 'below'}"
        off = f"z {tilt_deg(self.ground):.1f} degrees off its normal"
        return f"{self.found}, origin {height} the ground, {off}"

    def mounted(self, sweep: Sweep, settings: Settings) -> Sweep:
        """Returns the next sweep with its mounting, if that is known.

        What the first sweep shows is kept while frame and parameters stay.
        """
        key = sweep.frame_id, settings.lidars, settings.lidar_1, settings.ego_motion
        if key != self._key:
            self.forget()
            self._key = key
            self.found = _by_parameters(settings, sweep.frame_id)
            self._is_given = self.found is not None
        if sweep.mounting is not None and not self._is_given:
            self.found, self.ground, self.cones = sweep.mounting, None, None
        elif self.found is None:
            self._num_sweeps += 1
            # Looked for again at the sweeps 2, 4, 8 ...: each look takes some 10 ms.
            if self._num_sweeps & (self._num_sweeps - 1) == 0:
                self._look(sweep)
        if self.found is None:
            return sweep
        is_same = self.found is sweep.mounting or self.found.is_level
        return sweep if is_same else replace(sweep, mounting=self.found)

    def _look(self, sweep: Sweep) -> None:
        """Estimates the mounting by the ground and the beams."""
        rings, ground = sweep.rings, ground_of(sweep.xyz)
        if rings is not None and len(rings) == len(sweep):
            self.cones = BeamCones.of(sweep.xyz, rings)
        if ground is None:
            return
        off_deg = tilt_deg(ground)
        if not _MIN_WALL_DEG < off_deg < 180.0 - _MIN_WALL_DEG:
            up = _nearly_axis(ground[:3]) if off_deg > _MAX_TILT_DEG else _UP
            lens_m = None if self.cones is None else self.cones.lens_m
            source = "estimated from the ground" + ("" if lens_m is None else " and the beams")
            self.found = Mounting.of(up, np.zeros(3) if lens_m is None else lens_m, source)
        self.ground = ground


def _by_parameters(settings: Settings, frame_id: str) -> Mounting | None:
    """The mounting of one lidar by its parameters; None if they say nothing about it."""
    if settings.lidars.count > 1:
        return None
    pose, is_given = mounted_at(settings.lidar_1), settings.lidars.poses == "parameters"
    if frame_id == settings.lidars.frame:
        lens_m, up = pose[:3, 3], _UP
    else:
        lens_m = np.zeros(3)
        mounts = (pose, sensor_mount(settings.ego_motion))
        # The third row of a rotation is z of the level frame, in the axes of the sensor.
        up = next((own[2, :3] for own in mounts if own[2, 2] < 1.0), pose[2, :3])
    mounting = Mounting.of(up, lens_m, "by parameters")
    return mounting if is_given or not mounting.is_level else None


def ground_of(xyz: Floats32) -> Floats | None:
    """Returns (4,) n, h of the ground under points (N, 3), so that n x + h is a height above it.

    The ground is the plane with most points that has nearly none beyond it, if possible one that is
    nearly level. One as steep as a wall is taken only if none is level: the walls of corridors have
    more points than the floor. None if no ground is seen.
    """
    near = np.einsum("ij,ij->i", xyz, xyz) < _REACH_M**2
    points = thinned(chosen_points(xyz, near), _CELL_M).astype(np.float64)
    if len(points) < _MIN_POINTS:
        return None
    random = np.random.default_rng(0)
    points = points[random.permutation(len(points))[:_MAX_POINTS]]
    normals, heights, shares = _planes_of(points, random)
    is_level = normals[:, 2] >= np.cos(np.radians(_USUAL_TILT_DEG))
    is_wall = np.abs(normals[:, 2]) < np.cos(np.radians(_MIN_WALL_DEG))
    floor, wall = (np.argmax(np.where(each, shares, 0.0)) for each in (is_level, is_wall))
    is_near = abs(heights[floor]) < _TIMES_FARTHER * abs(heights[wall])
    if is_level[floor] and shares[floor] >= _MIN_SHARE and is_near:
        shares[is_wall] = 0.0
    # Between floor and ceiling, the frame is taken as it is.
    best = np.argmax(np.where(is_level, 2 * shares, shares))
    if shares.max() < _MIN_SHARE:
        return None
    own = points[np.abs(points @ normals[best] + heights[best]) < _TOLERANCE_M]
    middle = own.mean(axis=0)
    normal = np.linalg.svd(own - middle, full_matrices=False)[2][2]
    normal *= np.sign(normal @ normals[best])
    return np.append(normal, -normal @ middle)


def _nearly_axis(up: Floats) -> Floats:
    """The axis that is nearest to a normal (3,), if it is near; else the normal."""
    axis = np.round(up)
    return axis if np.linalg.norm(axis) == 1 and axis @ up > _NEARLY else up


def _planes_of(points: Floats, random: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Planes through points (N, 3), metres: random ones, and as many that are level.

    Returns:
        (K, 3) normals, upwards if they are ground; (K,) height of the origin above each; and (K,)
        share of the points on it, 0 unless it bounds the others.
    """
    first, second, third = points[random.integers(0, len(points), (3, _NUM_PLANES))]
    normals = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normals, axis=1)
    normals, first = normals[lengths > _CELL_M], first[lengths > _CELL_M]
    normals /= lengths[lengths > _CELL_M, None]
    # Few random planes hit a narrow floor.
    normals = np.concatenate([normals, np.broadcast_to(_UP, first.shape)])
    first = np.concatenate([first, first])
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
