"""The sensor's pose at the time of one sweep after the other, read along with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.ego_motion.pose_interpolation import interpolated_pose
from mnsf_ros.ego_motion.sensor_mount import robot_from_sensor
from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.tracks import in_stamp_order
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.poses import matrix_of
from mnsf_ros.recording.readable_messages import readable_messages
from mnsf_ros.settings import EgoMotionSettings
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp

# Between poses farther apart than this nobody knows how the sensor moved.
_MAX_GAP_NS: Final = 500_000_000
# Poses that may be left when a recording begins anew: half a second of a fast odometry.
_MAX_LEFTOVERS: Final = 50


@dataclass(frozen=True, eq=False)
class StampedPose:
    """A pose with its time.

    Attributes:
        stamp_ns: Integer nanoseconds.
        world_from_sensor: (4, 4) float64.
        frame_id: The moving frame as the message names it; empty if the settings have told how
            the sensor is mounted in it.
    """

    stamp_ns: int
    world_from_sensor: NDArray[np.float64]
    frame_id: str = ""


def recorded_poses(
    reader: BagReader, topic: str, findings: Findings, settings: EgoMotionSettings
) -> Iterator[StampedPose | None]:
    """Yields the sensor's poses of a nav_msgs/Odometry topic as received.

    Args:
        reader: An open recording.
        topic: The topic.
        findings: Gets what cannot be read.
        settings: Where the sensor is mounted in the frame whose poses these are.

    Yields:
        Poses; None where some may be missing.
    """
    mount = robot_from_sensor(settings)
    is_mounted = not np.array_equal(mount, np.eye(4))
    for number, item in enumerate(readable_messages(reader, topic)):
        if isinstance(item, Damage):
            findings.report(item)
            yield None
            continue
        message = item[1]
        try:
            stamp_ns = decode_stamp(message.header.stamp)
            pose = matrix_of(message.pose.pose)
        except (MessageError, RecordingError) as error:
            where = f"message {number} on {topic!r}"
            findings.report(Damage(str(reader.path), where, str(error)))
            yield None
            continue
        frame_id = "" if is_mounted else message.child_frame_id
        yield StampedPose(stamp_ns, pose @ mount, frame_id)


class PoseTrack:
    """Finds the pose at stamps that come in order; holds a few poses at a time."""

    def __init__(self, poses: Iterable[StampedPose | None]) -> None:
        """Starts before the first pose.

        Args:
            poses: Poses, about in stamp order; None where some may be missing.
        """
        self._poses = in_stamp_order(poses)
        self._before: StampedPose | None = None
        self._after: StampedPose | None = None
        self._advance()

    def pose_at(self, stamp_ns: int) -> StampedPose | None:
        """Returns the pose at a stamp, between two poses if need be; None where none is near."""
        if self._before is not None and stamp_ns < self._before.stamp_ns:
            self._skip_leftovers(stamp_ns)
        while self._after is not None and self._after.stamp_ns < stamp_ns:
            self._advance()
        if self._after is not None and self._after.stamp_ns == stamp_ns:
            return self._after
        if self._before is None or self._after is None:
            return None
        return _between(self._before, self._after, stamp_ns)

    def _advance(self) -> None:
        self._before, self._after = self._after, None
        for pose in self._poses:
            if pose is not None:
                self._after = pose
                return
            # Nobody knows what the sensor did where poses are missing.
            self._before = None

    def _skip_leftovers(self, stamp_ns: int) -> None:
        """Follows a jump back in time, past a few poses that came before it."""
        # Not past all: a single sweep with a wrong stamp must not cost the others their poses.
        for _ in range(_MAX_LEFTOVERS):
            if self._after is not None and self._after.stamp_ns > stamp_ns + _MAX_GAP_NS:
                self._advance()
        self._before = None


def _between(before: StampedPose, after: StampedPose, stamp_ns: int) -> StampedPose | None:
    gap_ns = after.stamp_ns - before.stamp_ns
    if gap_ns > _MAX_GAP_NS or before.stamp_ns > stamp_ns:
        return None
    share = (stamp_ns - before.stamp_ns) / gap_ns
    pose = interpolated_pose(before.world_from_sensor, after.world_from_sensor, share)
    return StampedPose(stamp_ns, pose, after.frame_id)
