# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a lidar without times of points turns: under which times static things stay in place."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mnsf_ros.ego_motion.ego_motion import EgoMotion
from mnsf_ros.geometry.point_sets import chosen_points, thinned
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# Things near by are seen first in front, then behind: at other times of a sweep.
_REACH_M: Final = 25.0
_CELL_M: Final = 0.2
_MAX_OFF_M: Final = 1.0
# Two sweeps are compared that are so far apart.
_MIN_WAY_M: Final = 10.0
_MIN_COMPARED: Final = 3
# The right times leave .76 to .90 as much, wrong ones, and all of snapshots, 1.0 and more.
_CLEARLY: Final = 0.95
_GUESSES: Final = tuple(
    AzimuthTimes(is_clockwise, start_deg)
    for start_deg in (180.0, -90.0, 0.0, 90.0)
    for is_clockwise in (True, False)
)


class LidarRotation(NamedTuple):
    """Distances of static points from those of a sweep some metres before, median in metres.

    Attributes:
        as_is_m: With sweeps as taken in one moment.
        least_m: With the best times by the azimuth.
        times: These times; None unless they are clearly better.
    """

    as_is_m: float
    least_m: float
    times: AzimuthTimes | None

    @classmethod
    def of(
        cls, sweeps: Sequence[Sweep], floor_m: float, settings: EgoMotionSettings
    ) -> "LidarRotation | None":
        """Compares sweeps in a row, levelled and without times; None if they are too near.

        Args:
            sweeps: The sweeps.
            floor_m: Lower points are ground, which shows no motion.
            settings: Of the registration.
        """
        as_is_m = _off_m(sweeps, None, floor_m, settings)
        if as_is_m is None:
            return None
        found = {guess: _off_m(sweeps, guess, floor_m, settings) or np.inf for guess in _GUESSES}
        best = min(found, key=lambda guess: found[guess])
        is_clear = found[best] < _CLEARLY * as_is_m
        return cls(as_is_m, found[best], best if is_clear else None)


def _off_m(
    sweeps: Sequence[Sweep],
    guess: AzimuthTimes | None,
    floor_m: float,
    settings: EgoMotionSettings,
) -> float | None:
    """Mean over pairs of sweeps of the median distance of points; None without enough pairs."""
    interval_s = float(np.median(np.diff([sweep.stamp_ns for sweep in sweeps]))) / NANOSECONDS
    ego_motion, clouds, places = EgoMotion(settings), [], []
    for own in sweeps:
        times_s = None if guess is None else guess.of(own.xyz, interval_s)
        sweep = replace(own, times_s=times_s)
        pose = ego_motion.pose_of(sweep)
        xyz = pose.in_one_moment(sweep)
        is_near = np.einsum("ij,ij->i", xyz, xyz) < _REACH_M**2
        xyz = thinned(chosen_points(xyz, is_near & (xyz[:, 2] > floor_m)), _CELL_M)
        clouds.append(apply(pose.world_from_sensor, xyz.astype(np.float64)))
        places.append(pose.world_from_sensor[:3, 3])
    off_m, last = [], 0
    for number, place in enumerate(places):
        if np.linalg.norm(place - places[last]) > _MIN_WAY_M:
            distances = cKDTree(clouds[last]).query(
                clouds[number], distance_upper_bound=_MAX_OFF_M
            )[0]
            off_m.append(float(np.median(distances[np.isfinite(distances)])))
            last += 2
    return float(np.mean(off_m)) if len(off_m) >= _MIN_COMPARED else None
