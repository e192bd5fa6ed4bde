# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A sweep matched with a map, and corrected for the motion that the match shows."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.covariance import six_axes
from mnsf_ros.ego_motion.deskewing import Deskewing
from mnsf_ros.ego_motion.pieces import Pieces, Testimony
from mnsf_ros.ego_motion.sweep_matcher import Placed, SweepMatcher
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# Maximum number of matches of a sweep, each with the motion found last.
_MAX_ROUNDS: Final = 3


@dataclass(frozen=True, eq=False)
class SweepPair:
    """A sweep to register, and the one before it.

    Attributes:
        last: The sweep before it.
        world_from_last: (4, 4) its pose.
        sweep: The sweep.
        expected: Its pose as expected; None if unknown.
    """

    last: Sweep
    world_from_last: Floats
    sweep: Sweep
    expected: Placed | None

    @property
    def interval_ns(self) -> int:
        """Nanoseconds between the stamps."""
        return self.sweep.stamp_ns - self.last.stamp_ns


@dataclass(frozen=True, eq=False)
class Match:
    """A registered sweep.

    Attributes:
        found: Its pose.
        motion: (4, 4) last_from_sweep.
        cloud: Its points for the map.
        map: The map that it was matched with; the sweep is not in it yet.
        azimuth_step_rad: Between the columns of the lidar.
        during: The motion during it; None if not known.
        bending: The motion expected during the next sweep; None if not used.
    """

    found: Placed
    motion: Floats
    cloud: Cloud
    map: SweepMatcher
    azimuth_step_rad: float
    during: SweepMotion | None
    bending: SweepMotion | None

    @cached_property
    def pieces(self) -> Pieces:
        """The pieces of the scene in it."""
        return Pieces.of(self.cloud, self.azimuth_step_rad)

    @cached_property
    def testimony(self) -> Testimony:
        """What they say of the motion since the last sweep."""
        motion = np.linalg.inv(self.map.last_pose) @ self.found.pose
        return Testimony.of(self.pieces, motion, self.map.last_cloud)


def matched(
    map_: SweepMatcher,
    pair: SweepPair,
    deskewing: Deskewing,
    settings: EgoMotionSettings,
    azimuth_step_rad: float,
) -> Match | None:
    """Returns the pose of a sweep by a map, near the expected one; None if nothing fits.

    With times of points, an unexpected motion changes the correction for the motion during the
    sweep: the sweep is matched again with it.
    """
    expected = pair.expected
    bending, elapsed_s = deskewing.motion_in(pair.sweep), pair.interval_ns / NANOSECONDS
    for _ in range(_MAX_ROUNDS):
        cloud = map_.prepared(pair.sweep, bending)
        found = None if cloud is None else map_.match(cloud, expected, elapsed_s)
        if cloud is None or found is None:
            return None
        during = None
        if bending is not None:
            axes = six_axes(found.pose[:3, :3])
            during = replace(bending, velocity=bending.velocity + axes.T @ found.velocity)
        motion = np.linalg.inv(pair.world_from_last) @ found.pose
        match = Match(found, motion, cloud, map_, azimuth_step_rad, during, None)
        refined = deskewing.of_step(pair.sweep, motion, pair.interval_ns)
        if refined is None or (bending is not None and refined.is_like(bending)):
            break
        if bending is None:
            # The map has the last sweep uncorrected, because its motion was unknown.
            map_ = SweepMatcher(settings)
            map_.add(map_.prepared(pair.last, refined), Placed(pair.world_from_last))
        expected, bending = expected or Placed(found.pose), refined
    if refined is None:
        refined = deskewing.expected
    elif bending is not None:
        refined = bending.towards(refined)
    return replace(match, bending=refined)
