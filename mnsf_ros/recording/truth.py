# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The true flow and the true sensor poses of a recording, see `docs/recordings.md`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
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

__all__ = ["FlowTruth", "read_sensor_poses", "read_truth"]


def read_truth(reader: BagReader, topic: str = TRUTH_FLOW_TOPIC) -> dict[int, FlowTruth]:
    """Returns stamp of a sweep (nanoseconds) -> its true flow, from first to last stamp.

    All of it is in memory, 20 bytes a point.

    Raises:
        RecordingError: There is no truth, two clouds have the same stamp, or damage is met.
    """
    topic = reader.find_topic(topic, CLOUD_TYPE)
    truth: dict[int, FlowTruth] = {}
    for message in reader.messages(topic):
        with _located(reader, topic, message.header.stamp):
            found = FlowTruth.decode(message)
        if found.stamp_ns in truth:
            raise RecordingError(
                f"{reader.path}: two clouds on {topic!r} have stamp {found.stamp_ns}"
            )
        truth[found.stamp_ns] = found
    return dict(sorted(truth.items()))


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
        with _located(reader, topic, message.header.stamp):
            poses[decode_stamp(message.header.stamp)] = pose_matrix(message.pose.pose)
    return dict(sorted(poses.items()))


@contextmanager
def _located(reader: BagReader, topic: str, stamp: StampLike) -> Iterator[None]:
    """Names the recording, topic and stamp of a message that cannot be used."""
    try:
        yield
    except (MessageError, RecordingError) as error:
        where = f"{reader.path}: {topic!r} at stamp {stamp.sec} s {stamp.nanosec} ns"
        raise RecordingError(f"{where}: {error}") from error
