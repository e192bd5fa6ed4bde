# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a lidar without times of points turns: under which times static things stay in place."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.geometry.point_sets import chosen_points, thinned
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# Enough to see it.
_NUM_SWEEPS: Final = 40
_MAX_WAY_M: Final = 30.0
# Things near by are seen first in front, then behind: at other times of a sweep. Two sweeps are
# compared that are so far apart. The ground shows no motion.
_MIN_WAY_M: Final = 10.0
_NEAR_M: Final = 25.0
_CELL_M: Final = 0.2
_MAX_OFF_M: Final = 1.0
_GROUND_M: Final = 0.4
_MIN_COMPARED: Final = 3
# The right times leave .65 to .92 as much; for clouds that are corrected, all leave 1.0 and more.
_CLEARLY: Final = 0.95
_GUESSES: Final = tuple(
    AzimuthTimes(is_clockwise, start_deg)
    for start_deg in (180.0, -90.0, 0.0, 90.0)
    for is_clockwise in (True, False)
)


class Rotation(NamedTuple):
    """Times that fit clearly better than one moment, and the distances of static points, metres."""

    times: AzimuthTimes
    off_m: float
    off_without_m: float


class LidarRotation:
    """Compares static points with those of a sweep some metres before, under several times."""

    def __init__(self, settings: EgoMotionSettings, mounting: MountingEstimate) -> None:
        self._settings = replace(settings, source=EgoSource.REGISTRATION.value)
        self._mounting = mounting
        self._located: list[Located] = []

    def add(self, located: Located) -> None:
        """Takes the next sweep, which has no times."""
        kept = self._located
        if located.source == EgoSource.CONSTANT_VELOCITY.value:
            kept.clear()  # as where a recording begins again
        elif self._is_level and not (kept and _way_m(kept[0], kept[-1]) > _MAX_WAY_M):
            kept.append(replace(located, sweep=replace(located.sweep, source=None)))
            del kept[:-_NUM_SWEEPS]

    @property
    def _is_level(self) -> bool:
        """Whether azimuths of sweeps are those of the clouds."""
        mounting = self._mounting.found
        return mounting is None or mounting.is_level

    def find(self) -> Rotation | None:
        """Registers the sweeps under each guess, which takes seconds, and returns the rotation.

        None if there is none, or if the sensor has not moved enough.
        """
        kept = self._located
        if len(kept) < _MIN_COMPARED or _way_m(kept[0], kept[-1]) < _MIN_WAY_M:
            return None
        ground = self._mounting.ground
        floor_m = -np.inf if ground is None else _GROUND_M - float(ground[3])
        sweeps = [one.sweep for one in kept]
        off_without_m = self._off_m(sweeps, None, floor_m)
        off_m = {guess: self._off_m(sweeps, guess, floor_m) for guess in _GUESSES}
        best = min(_GUESSES, key=lambda guess: off_m[guess])
        is_clear = off_m[best] < _CLEARLY * off_without_m < np.inf
        return Rotation(best, off_m[best], off_without_m) if is_clear else None

    def _off_m(self, sweeps: list[Sweep], guess: AzimuthTimes | None, floor_m: float) -> float:
        """Mean of the median distances of points in pairs of sweeps; infinite for too few pairs."""
        interval_s = float(np.median(np.diff([sweep.stamp_ns for sweep in sweeps]))) / NANOSECONDS
        ego_motion = EgoMotion(self._settings)
        clouds, places = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
        for own in sweeps:
            times_s = None if guess is None else guess.of(own.xyz, interval_s)
            sweep = replace(own, times_s=times_s)
            pose = ego_motion.pose_of(sweep)
            if pose.source is EgoSource.CONSTANT_VELOCITY:
                return np.inf
            xyz = pose.in_one_moment(sweep)
            is_near = np.einsum("ij,ij->i", xyz, xyz) < _NEAR_M**2
            xyz = thinned(chosen_points(xyz, is_near & (xyz[:, 2] > floor_m)), _CELL_M)
            placed = apply(pose.world_from_sensor, xyz.astype(np.float64))
            clouds.append(np.asarray(placed, np.float64))
            places.append(pose.world_from_sensor[:3, 3])
        off_m, last = [], 0
        for place, cloud in zip(places, clouds, strict=True):
            if np.linalg.norm(place - places[last]) > _MIN_WAY_M and len(clouds[last]):
                off, _ = cKDTree(clouds[last]).query(cloud, distance_upper_bound=_MAX_OFF_M)
                off_m += [float(np.median(off[np.isfinite(off)]))] if np.isfinite(off).any() else []
                last += 2
        return float(np.mean(off_m)) if len(off_m) >= _MIN_COMPARED else np.inf


def _way_m(first: Located, last: Located) -> float:
    way = last.world_from_sensor - first.world_from_sensor
    return float(np.linalg.norm(way[:3, 3]))
