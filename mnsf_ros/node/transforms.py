# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Transforms between frames, by tf2_ros where it is installed."""

import importlib
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from mnsf_ros.arrays import Floats
from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.errors import MnsfError, SettingsError, shortened
from mnsf_ros.geometry.transforms import pose_quaternion, transform_matrix
from msg_utils.errors import MessageError


class TransformError(MnsfError):
    """There is no transform between two frames, or not at that time."""


class Transforms:
    """The transforms on /tf and /tf_static. May be used from any thread."""

    def __init__(self, node: Node, purpose: str) -> None:
        """Subscribes.

        Raises:
            SettingsError: If tf2_ros is missing; it names the purpose, and how to install it.
        """
        self._tf2 = _tf2_ros(purpose)
        self._buffer = self._tf2.Buffer()
        self._listener = self._tf2.TransformListener(self._buffer, node)

    def close(self) -> None:
        """Unsubscribes."""
        self._listener.unregister()

    def forget(self) -> None:
        """Forgets all transforms that may change: time has jumped back."""
        self._buffer.clear()

    def fixed_frame(self, wanted: str) -> str:
        """Returns the wanted frame, or the only one of that name in a namespace.

        Raises:
            TransformError: If TF has neither; it lists the frames.
        """
        frames, name = sorted(self._buffer._getFrameStrings()), wanted.lstrip("/")
        found = [frame for frame in frames if frame == name or frame.endswith(f"/{name}")]
        if name in found:
            return name
        if len(found) == 1:
            return found[0]
        raise TransformError(
            f"TF has no frame {name!r}, but {shortened(frames)}: name one with tf.fixed_frame"
        )

    def find(self, target: str, source: str, stamp_ns: int | None = None) -> Floats:
        """Returns (4, 4) target_from_source at a stamp; the newest one without a stamp.

        Raises:
            TransformError: If there is none.
        """
        # Frames of ROS 1 had a slash; tf2 refuses them.
        frames = target.lstrip("/"), source.lstrip("/")
        time = Time(nanoseconds=stamp_ns or 0)
        try:
            found = self._buffer.lookup_transform(*frames, time)
            return transform_matrix(found.transform)
        except (self._tf2.TransformException, MessageError) as error:
            raise TransformError(
                f"no transform from {frames[1]!r} to {frames[0]!r}: {error}"
            ) from None


class OdometryFrame:
    """Broadcasts the robot's pose in the frame of `~/ego_motion`. May be used from any thread."""

    def __init__(self, node: Node, odom_frame: str, base_frame: str) -> None:
        """Advertises /tf for a frame of the robot; an empty one means the frame of the clouds.

        Raises:
            SettingsError: If tf2_ros is missing.
        """
        tf2 = _tf2_ros("tf.broadcast")
        self._broadcaster = tf2.TransformBroadcaster(node)
        self._odom_frame, self._base_frame = odom_frame, base_frame

    def publish(self, header: Header, known: OverGround, transforms: Transforms | None) -> None:
        """Broadcasts the pose at the sweep of a cloud's header.

        Raises:
            TransformError: If the pose of the lidar on the robot is unknown.
        """
        pose, child = known.world_from_sensor, self._base_frame or header.frame_id
        if transforms is not None and child != header.frame_id:
            pose = pose @ transforms.find(header.frame_id, child)
        message = TransformStamped(child_frame_id=child.lstrip("/"))
        message.header.stamp, message.header.frame_id = header.stamp, self._odom_frame
        place, turn = message.transform.translation, message.transform.rotation
        place.x, place.y, place.z = pose[:3, 3].tolist()
        turn.x, turn.y, turn.z, turn.w = pose_quaternion(pose)
        self._broadcaster.sendTransform(message)


def _tf2_ros(purpose: str) -> Any:  # noqa: ANN401 - a module that may be missing
    try:
        return importlib.import_module("tf2_ros")
    except ImportError:
        raise SettingsError(
            f"{purpose} needs the Python package tf2_ros, which is not installed: sudo apt install "
            "ros-$ROS_DISTRO-tf2-ros-py (the ROS wheels from PyPI have none)"
        ) from None
