"""The subscription to the robot's odometry, where the settings want it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.geometry.transforms import pose_matrix, sensor_mount
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp

UNDECODABLE = "odometry_undecodable"
OUT_OF_ORDER = "odometry_out_of_order"


class OdometrySubscription:
    """Remembers odometry, and tells each sweep where the sensor was."""

    def __init__(
        self,
        node: Node,
        topic: str,
        settings: EgoMotionSettings,
        on_bad: Callable[[str, str], None],
        guarded: Callable[[Callable[..., None]], Callable[..., None]],
    ) -> None:
        """Subscribes, unless the settings do without odometry.

        Args:
            node: The node.
            topic: Name of the topic, before remapping.
            settings: Whether to listen, and where the sensor sits.
            on_bad: Gets the name of the fault of a message that is left out, and what is wrong.
            guarded: Makes a callback one that raises nothing.
        """
        self._node = node
        self._topic = topic
        self._on_bad = on_bad
        self._callback = guarded(self._on_message)
        self._subscription: Any = None
        self.change_settings(settings)

    def change_settings(self, settings: EgoMotionSettings) -> None:
        """Lets other settings hold; what was heard before is forgotten."""
        self._track = PoseTrack(mount=sensor_mount(settings))
        is_wanted = settings.source == "odometry"
        if is_wanted and self._subscription is None:
            self._subscription = self._node.create_subscription(
                Odometry, self._topic, self._callback, qos_profile_sensor_data
            )
        elif not is_wanted and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def located(self, sweep: Sweep) -> Sweep:
        """The sweep with the sensor's pose by odometry, if that is known."""
        pose = self._track.pose_at(sweep.stamp_ns)
        return sweep if pose is None else replace(sweep, odometry=pose.world_from_frame)

    def _on_message(self, message: Odometry) -> None:
        try:
            stamp_ns = decode_stamp(message.header.stamp)
            if stamp_ns == 0:
                raise MessageError("no stamp, expected the time of the pose")
            pose = StampedPose(stamp_ns, pose_matrix(message.pose.pose), message.child_frame_id)
        except MessageError as error:
            self._on_bad(UNDECODABLE, str(error))
            return
        if not self._track.add(pose):
            self._on_bad(OUT_OF_ORDER, f"stamp {stamp_ns} is not after the last one")
