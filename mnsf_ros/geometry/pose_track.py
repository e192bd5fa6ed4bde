# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recent poses, and the pose at the stamp of a sweep."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final, TypeAlias

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.geometry.stamped_track import StampedTrack
from mnsf_ros.geometry.transforms import interpolated_pose, pose_matrix
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp

# Any object with the attributes of nav_msgs/Odometry.
OdometryLike: TypeAlias = Any

_MAX_POSES: Final = 2000
# For a robot that brakes with 4 m/s² the interpolation is then off by 0.045 m.
_MAX_GAP_NS: Final = 300_000_000
# A sweep may be decoded before the odometry of its time arrives: the motion is extrapolated this
# far ...
_MAX_AHEAD_NS: Final = 100_000_000
# ... from poses this far apart: the noise of neighbouring poses would grow on the way.
_MIN_BASE_NS: Final = 50_000_000


@dataclass(frozen=True, eq=False)
class StampedPose:
    """A pose with its time."""

    stamp_ns: int
    world_from_frame: Floats  # (4, 4)
    frame_id: str = ""  # name of the moving frame in the message

    @classmethod
    def of(cls, message: OdometryLike) -> "StampedPose":
        """Returns the pose of a nav_msgs/Odometry.

        Raises:
            MessageError: It has no stamp, or no pose that can be.
        """
        stamp_ns = decode_stamp(message.header.stamp)
        if stamp_ns == 0:
            raise MessageError("no stamp, expected the time of the pose")
        return cls(stamp_ns, pose_matrix(message.pose.pose), message.child_frame_id)


_STAMP: Final = attrgetter("stamp_ns")


class PoseTrack(StampedTrack[StampedPose]):
    """The last 2000 poses, interpolated at any stamp."""

    def __init__(
        self, recorded: Iterable[StampedPose | None] = (), mount: Floats | None = None
    ) -> None:
        """Starts without a pose.

        Args:
            recorded: Poses to read on the way, in stamp order; None where some may be missing.
            mount: (4, 4) frame_from_sensor in the moving frame of the poses; None if the poses are
                those of the sensor.
        """
        super().__init__(recorded, _MAX_POSES)
        self._mount = None if mount is None or np.array_equal(mount, np.eye(4)) else mount

    def pose_at(self, stamp_ns: int) -> StampedPose | None:
        """Returns the pose of the sensor at a stamp; None without poses near it.

        Between poses up to 0.3 s apart it is interpolated, up to 0.1 s after a pose extrapolated.
        The pose of a mounted sensor has no frame_id.
        """
        self.read_until(stamp_ns)
        pose = self._found(stamp_ns)
        if pose is None or self._mount is None:
            return pose
        return StampedPose(stamp_ns, pose.world_from_frame @ self._mount)

    def _found(self, stamp_ns: int) -> StampedPose | None:
        after = bisect_left(self._items, stamp_ns, key=_STAMP)
        if after == len(self._items):
            return self._extrapolated(after - 1, stamp_ns)
        if self._items[after].stamp_ns == stamp_ns:
            return self._items[after]
        if after == 0:
            return None
        if self._gap_ns(after - 1, after) > _MAX_GAP_NS:
            return self._extrapolated(after - 1, stamp_ns)
        return self._on_line(after - 1, after, stamp_ns)

    def _extrapolated(self, last: int, stamp_ns: int) -> StampedPose | None:
        """Returns the pose shortly after the last one, if another one is near before that."""
        if last < 1:
            return None
        last_ns = self._items[last].stamp_ns
        base = bisect_right(self._items, last_ns - _MIN_BASE_NS, key=_STAMP) - 1
        if base < 0 or self._gap_ns(base, last) > _MAX_GAP_NS:
            # There is a gap, or nothing, before the poses just before.
            base += 1
        base = min(base, last - 1)
        if stamp_ns - last_ns > _MAX_AHEAD_NS or self._gap_ns(base, last) > _MAX_GAP_NS:
            return None
        return self._on_line(base, last, stamp_ns)

    def _gap_ns(self, first: int, second: int) -> int:
        return self._items[second].stamp_ns - self._items[first].stamp_ns

    def _on_line(self, first: int, second: int, stamp_ns: int) -> StampedPose:
        before, after = self._items[first], self._items[second]
        share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        pose = interpolated_pose(before.world_from_frame, after.world_from_frame, share)
        return StampedPose(stamp_ns, pose, after.frame_id)
