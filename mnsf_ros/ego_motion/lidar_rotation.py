# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether points without times were measured one after the other, as a turning lidar does."""

from collections import deque
from dataclasses import replace
from typing import Final, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.ego_motion import EgoSource, SensorPose
from mnsf_ros.ego_motion.sweep_matcher import Placed, SweepMatcher
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.settings import EgoMotionSettings, Settings
from mnsf_ros.sweeps.azimuth_times import times_in_order
from mnsf_ros.sweeps.sweep import NANOSECONDS, Start, Sweep, SweepTriplet

# Things near by are seen first in front, then behind: at other times of a sweep.
_NEAR_M: Final = 25.0
_STEP_M: Final = 2.5
_NUM_STEPS: Final = 2
# Slower, distortion is as small as the noise of registration.
_MIN_SPEED_M_S: Final = 4.0
# Evidence is the logarithm of a ratio of shares of matched points; together, not alone, the last
# comparisons decide. The sum is above .2 within 24 m for RADIATE and eight of nine simulated
# lidars that turn, and .15 at most for clouds of one moment: 18 streets with points in four orders.
_NUM_COMPARED: Final = 5
_CLEARLY: Final = 0.2
_MOST: Final = 0.1
_MAX_COMPARED: Final = 20
_NUM_INTERVALS: Final = 8

PosedSweep = tuple[Sweep, SensorPose]


class _View(NamedTuple):
    """A sweep with times in the order of its points, as taken in one moment, and backwards."""

    world_from_sensor: Floats
    clouds: tuple[Cloud, ...]


class LidarRotation:
    """Finds out whether the points of a stream without times are in the order of measurement.

    It compares static things with those of a sweep 5 m before: with times in the order of the
    points, as taken in one moment, and with times in the reverse order. The first must agree better
    than both: among traffic, any distortion may agree by chance. What is found once holds. Nothing
    is done where the user says the times, or points are not corrected by them.

    Attributes:
        is_found: Whether the lidar turns; None while that is looked for.
    """

    def __init__(self) -> None:
        self._intervals_s: deque[float] = deque(maxlen=_NUM_INTERVALS)
        self._timed: WeakKeyDictionary[Sweep, Sweep] = WeakKeyDictionary()
        self.forget()

    def forget(self) -> None:
        """Starts anew, as for another lidar. Another thread may still take times."""
        self.is_found: bool | None = None
        self._views: deque[_View] = deque(maxlen=1 + _NUM_STEPS)
        self._evidence: list[float] = []

    def begin(self, start: Start) -> None:
        """Compares with no sweep before a new start, and starts anew with another frame."""
        if start is Start.COLD_FRAME:
            self.forget()
        self._views.clear()

    def timed(self, triplet: SweepTriplet, settings: Settings) -> SweepTriplet:
        """Returns the triplet, with times if the lidar turns. Each sweep is always the same one."""
        if not (self.is_found and _are_wanted(settings)):
            return triplet
        return triplet.changed(self._with_times)

    def _with_times(self, sweep: Sweep) -> Sweep:
        if sweep.times_s is not None:
            return sweep
        if sweep not in self._timed:
            times_s = times_in_order(sweep.xyz, self._interval_s)
            self._timed[sweep] = replace(sweep, times_s=times_s)
        return self._timed[sweep]

    def learn(self, last: PosedSweep, newest: PosedSweep, settings: Settings) -> bool:
        """Takes two consecutive sweeps. Returns whether they show that the lidar turns."""
        (before, before_pose), (sweep, pose) = last, newest
        interval_s = (sweep.stamp_ns - before.stamp_ns) / NANOSECONDS
        if self.is_found is not None or sweep.times_s is not None or interval_s <= 0:
            return False
        if not _are_wanted(settings):
            return False
        if pose.source is EgoSource.LOST:
            self._views.clear()
            return False
        self._intervals_s.append(interval_s)
        step = np.linalg.inv(before_pose.world_from_sensor) @ pose.world_from_sensor
        motion = SweepMotion.of_step(step, interval_s, 0.0)
        is_fast = np.linalg.norm(motion.velocity[:3]) > _MIN_SPEED_M_S
        if is_fast and self._is_far(pose.world_from_sensor):
            self._compare(sweep, pose.world_from_sensor, motion, settings.ego_motion)
        return bool(self.is_found)

    @property
    def _interval_s(self) -> float:
        return float(np.median(self._intervals_s))

    def _is_far(self, pose: Floats) -> bool:
        """Whether the sensor moved by a step since the last view."""
        if not self._views:
            return True
        way = pose[:3, 3] - self._views[-1].world_from_sensor[:3, 3]
        return bool(np.linalg.norm(way) > _STEP_M)

    def _compare(
        self, sweep: Sweep, pose: Floats, motion: SweepMotion, settings: EgoMotionSettings
    ) -> None:
        """Weighs which times agree best with the view two steps before."""
        near = replace(settings, max_range_m=_NEAR_M)
        times_s = times_in_order(sweep.xyz, self._interval_s)
        if times_s is None:
            return
        orders = (replace(sweep, times_s=sign * times_s) for sign in (1, 0, -1))
        view = _View(pose, tuple(Cloud.of(each, motion, near).upper for each in orders))
        self._views.append(view)
        if len(self._views) <= _NUM_STEPS:
            return
        shares = []
        for before, cloud in zip(self._views[0].clouds, view.clouds, strict=True):
            matcher = SweepMatcher(near)
            matcher.add(before, Placed(self._views[0].world_from_sensor))
            shares.append(matcher.share_matched(cloud, pose))
        turning, *others = shares
        if turning > 0 and max(others) > 0:
            self._weigh(float(np.log(turning / max(others))))

    def _weigh(self, evidence: float) -> None:
        self._evidence.append(float(np.clip(evidence, -_MOST, _MOST)))
        last = sum(self._evidence[-_NUM_COMPARED:])
        if abs(last) > _CLEARLY or len(self._evidence) == _MAX_COMPARED:
            self.is_found = last > _CLEARLY
        if self.is_found is not None:
            self._views.clear()


def _are_wanted(settings: Settings) -> bool:
    """Whether times of points are to be found, and used."""
    return settings.time.field == "auto" and settings.ego_motion.deskew
