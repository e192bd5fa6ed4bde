"""The last poses of the robot's odometry, and the sensor's pose at the stamp of a sweep."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.ego_motion.pose_interpolation import interpolated_pose
from mnsf_ros.ego_motion.sensor_mount import robot_from_sensor
from mnsf_ros.settings import EgoMotionSettings

_MAX_POSES: Final = 2000
# Between poses farther apart nobody knows how the robot moved.
_MAX_GAP_NS: Final = 300_000_000
# A sweep may be decoded before the odometry of its time has come.
_MAX_AHEAD_NS: Final = 100_000_000
# It is taken from poses this far apart: the noise of neighbors would grow with the way ahead.
_MIN_BASE_NS: Final = 50_000_000
# Older than this beside the newest pose, a pose is from a clock that jumped.
_JUMP_NS: Final = 1_000_000_000


class OdometryTrack:
    """Takes poses as they come. Not for use from several threads at once."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._stamps_ns: deque[int] = deque(maxlen=_MAX_POSES)
        self._poses: deque[NDArray[np.float64]] = deque(maxlen=_MAX_POSES)
        self._robot_from_sensor = robot_from_sensor(settings)

    def add(self, stamp_ns: int, world_from_robot: NDArray[np.float64]) -> bool:
        """Takes a pose, (4, 4); False if it is not newer than the last one and is left out.

        A pose that is much older is of a clock that jumped, as when a bag loops: all before it is
        forgotten.
        """
        if self._stamps_ns and stamp_ns < self._stamps_ns[-1] - _JUMP_NS:
            self._stamps_ns.clear()
            self._poses.clear()
        if self._stamps_ns and stamp_ns <= self._stamps_ns[-1]:
            return False
        self._stamps_ns.append(stamp_ns)
        self._poses.append(world_from_robot)
        return True

    def sensor_pose_at(self, stamp_ns: int) -> NDArray[np.float64] | None:
        """(4, 4) world_from_sensor at a stamp; None where no poses are near."""
        pose = self._robot_pose_at(stamp_ns)
        return None if pose is None else pose @ self._robot_from_sensor

    def _robot_pose_at(self, stamp_ns: int) -> NDArray[np.float64] | None:
        stamps_ns = self._stamps_ns
        after = bisect_left(stamps_ns, stamp_ns)
        if after < len(stamps_ns) and stamps_ns[after] == stamp_ns:
            return self._poses[after]
        if after == len(stamps_ns):
            return self._pose_ahead(stamp_ns)
        return self._pose_between(after - 1, after, stamp_ns) if after else None

    def _pose_ahead(self, stamp_ns: int) -> NDArray[np.float64] | None:
        """The pose that is not there yet: the last motion goes on for a moment."""
        stamps_ns = self._stamps_ns
        if len(stamps_ns) < 2 or stamp_ns - stamps_ns[-1] > _MAX_AHEAD_NS:
            return None
        base = bisect_right(stamps_ns, stamps_ns[-1] - _MIN_BASE_NS) - 1
        if base < 0 or stamps_ns[-1] - stamps_ns[base] > _MAX_GAP_NS:
            # Between the newest poses and those before them is a gap, or nothing.
            base = base + 1
        base = min(base, len(stamps_ns) - 2)
        return self._pose_between(base, len(stamps_ns) - 1, stamp_ns)

    def _pose_between(self, first: int, second: int, stamp_ns: int) -> NDArray[np.float64] | None:
        gap_ns = self._stamps_ns[second] - self._stamps_ns[first]
        if gap_ns > _MAX_GAP_NS:
            return None
        share = (stamp_ns - self._stamps_ns[first]) / gap_ns
        return interpolated_pose(self._poses[first], self._poses[second], share)
