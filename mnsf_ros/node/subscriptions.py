# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The subscriptions to the lidar and, where the settings want it, to the robot's odometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions, QoSPolicyKind
from sensor_msgs.msg import PointCloud2

from mnsf_ros.geometry.pose_messages import pose_matrix
from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.geometry.transforms import sensor_mount
from mnsf_ros.node.transforms import Transforms
from mnsf_ros.online.watches import CLOUDS_MISSED, MissedClouds
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp

# Callbacks only decode and hand over, so waiting messages mean a short stall, not a queue.
_DEPTH = 5

# The reliability is a parameter of its own, because it changes.
_OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH)

_LOST = (
    "sweeps_lost_in_transport",
    "sweeps are lost in transport: publish them reliable, or start the publisher with the Fast DDS "
    "profile of this package (see docs/getting_started.md)",
)
_MISSED = (
    CLOUDS_MISSED,
    "clouds were published that this node has not seen: lost in transport, or overwritten in its "
    "queue because the computer is too busy",
)

Guard: TypeAlias = Callable[[Callable[..., None]], Callable[..., None]]


class InputSubscription:
    """Subscribes best effort, or reliable where every publisher is.

    Reliable transport loses no large clouds, but a reliable subscription gets nothing from a
    best-effort publisher. `BEST_AVAILABLE` decides once, often before the publisher is there, so
    this looks again and again: call `refresh` from a timer.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        reliability: str,
        on_cloud: Callable[[PointCloud2], None],
        report: Callable[[str, str, int], None],
        guarded: Guard,
    ) -> None:
        """Subscribes with reliability `auto`, `reliable` or `best_effort`.

        `report` gets an event, what to say of it, and how often it has just happened; `guarded`
        makes a callback one that raises nothing.
        """
        self._node = node
        self._topic = topic
        self._wanted = reliability
        self._on_cloud = on_cloud
        self._report = report
        self._missed = MissedClouds()
        self._callback = guarded(self._receive)
        self._is_reliable = reliability == "reliable"
        self._subscription = self._subscribe()

    @property
    def topic(self) -> str:
        """Full name of the topic, after remapping."""
        return str(self._subscription.topic_name)

    @property
    def reliability(self) -> str:
        """`reliable` or `best_effort`, as subscribed now."""
        return "reliable" if self._is_reliable else "best_effort"

    @property
    def num_publishers(self) -> int:
        """Publishers of the topic that can be seen now."""
        return int(self._node.count_publishers(self.topic))

    def refresh(self) -> bool:
        """Subscribes anew if the publishers offer something else; True if it did."""
        if self._wanted != "auto":
            return False
        offered = self._node.get_publishers_info_by_topic(self.topic)
        # Without publishers best effort, which suits whichever comes.
        all_reliable = bool(offered) and all(
            info.qos_profile.reliability == ReliabilityPolicy.RELIABLE for info in offered
        )
        if all_reliable == self._is_reliable:
            return False
        self._is_reliable = all_reliable
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe()
        return True

    def _subscribe(self) -> Any:  # noqa: ANN401 - rclpy's type differs between releases
        policy = ReliabilityPolicy.RELIABLE if self._is_reliable else ReliabilityPolicy.BEST_EFFORT
        return self._node.create_subscription(
            PointCloud2,
            self._topic,
            self._callback,
            QoSProfile(depth=_DEPTH, reliability=policy),
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=lambda event: self._report(*_LOST, int(event.total_count_change))
            ),
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )

    def _receive(self, message: PointCloud2, info: dict[str, Any]) -> None:
        stamp = message.header.stamp
        stamp_ns = stamp.sec * NANOSECONDS + stamp.nanosec
        number = info["publication_sequence_number"]
        missed = self._missed.before(number, stamp_ns, self.num_publishers)
        if missed:
            self._report(*_MISSED, missed)
        self._on_cloud(message)


class OdometrySubscription:
    """Remembers odometry, and tells each sweep where the sensor was."""

    def __init__(
        self,
        node: Node,
        topic: str,
        report: Callable[[str, str], None],
        guarded: Guard,
    ) -> None:
        """Does nothing until it gets its settings.

        `report` gets the name of the fault of a message that is left out, and what to say of it;
        `guarded` makes a callback one that raises nothing.
        """
        self._node = node
        self._topic = topic
        self._report = report
        self._callback = guarded(self._on_message)
        self._subscription: Any = None
        self._transforms: Transforms | None = None
        self._track = PoseTrack()

    def change_settings(self, settings: EgoMotionSettings, transforms: Transforms | None) -> None:
        """Lets other settings hold, subscribes or not; what was heard before is forgotten.

        `transforms` tell where the sensor is on the robot, if the settings want that.
        """
        self._transforms = transforms if settings.sensor_pose == "tf" else None
        self._track = PoseTrack(mount=None if self._transforms else sensor_mount(settings))
        is_wanted = settings.source == "odometry"
        if is_wanted and self._subscription is None:
            self._subscription = self._node.create_subscription(
                Odometry, self._topic, self._callback, qos_profile_sensor_data
            )
        elif not is_wanted and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def located(self, sweep: Sweep) -> Sweep:
        """Returns the sweep with the sensor's pose by odometry, if that is known.

        Raises:
            TransformError: If it is not known where the sensor is on the robot.
        """
        pose = self._track.pose_at(sweep.stamp_ns)
        if pose is None:
            return sweep
        world_from_sensor = pose.world_from_frame
        if self._transforms is not None:
            world_from_sensor = world_from_sensor @ self._transforms.find(
                pose.frame_id, sweep.frame_id
            )
        return replace(sweep, odometry=world_from_sensor)

    def _on_message(self, message: Odometry) -> None:
        try:
            stamp_ns = decode_stamp(message.header.stamp)
            if stamp_ns == 0:
                raise MessageError("no stamp, expected the time of the pose")
            pose = StampedPose(stamp_ns, pose_matrix(message.pose.pose), message.child_frame_id)
        except MessageError as error:
            self._report("odometry_undecodable", f"an odometry message is skipped: {error}")
            return
        if not self._track.add(pose):
            text = f"an odometry message is skipped: stamp {stamp_ns} is not after the last one"
            self._report("odometry_out_of_order", text)
