# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The true flow and the true sensor poses of a recording, see `docs/recordings.md`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from mnsf_ros.errors import RecordingError
from mnsf_ros.geometry.pose_messages import pose_matrix
from mnsf_ros.recording.bag_topics import CLOUD_TYPE, ODOMETRY_TYPE, TRUTH_FLOW_TOPIC
from mnsf_ros.recording.flow_truth import FlowTruth
from msg_utils.errors import MessageError
from msg_utils.stamps import StampLike, decode_stamp

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mnsf_ros.recording.bag_reader import BagReader

__all__ = ["FlowTruth", "FlowTruthIndex", "read_sensor_poses", "read_truth"]


class FlowTruthIndex(Mapping[int, FlowTruth]):
    """Sweep stamp (nanoseconds) -> truth; clouds are read when asked for, not before."""

    def __init__(self, reader: BagReader, topic: str, received_ns: dict[int, int]) -> None:
        """Takes an open reader, which must stay open, and header stamp -> receive time."""
        self._reader = reader
        self._topic = topic
        self._received_ns = received_ns

    def __getitem__(self, stamp_ns: int) -> FlowTruth:
        """Returns the truth of the sweep with this stamp; KeyError if there is none."""
        received = self._received_ns[stamp_ns]
        where = f"{self._reader.path}: {self._topic!r} at stamp {stamp_ns}"
        for message in self._reader.messages(self._topic, start_ns=received, stop_ns=received + 1):
            if decode_stamp(message.header.stamp) == stamp_ns:
                try:
                    return FlowTruth.decode(message)
                except RecordingError as error:
                    raise RecordingError(f"{where}: {error}") from error
        raise RecordingError(f"{where}: is not found at its receive time again")

    def __iter__(self) -> Iterator[int]:
        """Yields the stamps from first to last."""
        return iter(self._received_ns)

    def __len__(self) -> int:
        """Returns the number of sweeps with truth."""
        return len(self._received_ns)


def read_truth(reader: BagReader, topic: str = TRUTH_FLOW_TOPIC) -> FlowTruthIndex:
    """Index the truth clouds of a recording by the stamp of their sweep.

    Raises:
        RecordingError: There is no truth, two clouds have the same stamp, or damage is met.
    """
    topic = reader.find_topic(topic, CLOUD_TYPE)
    received_ns: dict[int, int] = {}
    for received, message in reader.received_messages(topic):
        stamp_ns = _stamp(reader, topic, message.header.stamp)
        if stamp_ns in received_ns:
            raise RecordingError(f"{reader.path}: two clouds on {topic!r} have stamp {stamp_ns}")
        received_ns[stamp_ns] = received
    return FlowTruthIndex(reader, topic, dict(sorted(received_ns.items())))


def read_sensor_poses(
    reader: BagReader, topic: str | None = None
) -> dict[int, NDArray[np.float64]]:
    """Returns stamp (nanoseconds) -> (4, 4) `world_from_sensor`, from first to last stamp.

    If no topic is named, it is the only one of nav_msgs/Odometry.

    Raises:
        RecordingError: There is no such topic, a pose is no pose, or damage is met.
    """
    topic = reader.find_topic(topic, ODOMETRY_TYPE)
    poses: dict[int, NDArray[np.float64]] = {}
    for message in reader.messages(topic):
        stamp_ns = _stamp(reader, topic, message.header.stamp)
        try:
            poses[stamp_ns] = pose_matrix(message.pose.pose)
        except MessageError as error:
            where = f"{reader.path}: {topic!r} at stamp {stamp_ns}"
            raise RecordingError(f"{where}: {error}") from error
    return dict(sorted(poses.items()))


def _stamp(reader: BagReader, topic: str, stamp: StampLike) -> int:
    try:
        return decode_stamp(stamp)
    except MessageError as error:
        raise RecordingError(f"{reader.path}: {topic!r}: {error}") from error
