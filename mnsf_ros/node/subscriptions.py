# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The subscriptions to the lidars, an IMU, and the robot's odometry if the settings ask for it."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, Generic, TypeAlias, TypeVar

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions, QoSPolicyKind
from sensor_msgs.msg import Imu, PointCloud2

from mnsf_ros.arrays import Floats
from mnsf_ros.errors import SettingsError
from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.geometry.stamped_rate import StampedRate
from mnsf_ros.geometry.stamped_track import Stamped, StampedTrack
from mnsf_ros.geometry.transforms import sensor_mount
from mnsf_ros.node.cloud_topics import PLAYERS, CloudSearch, cloud_class, fault_of
from mnsf_ros.node.diagnostics import CLOUDS_EMPTY, CLOUDS_MISSED, CLOUDS_UNDECODABLE, SWEEPS_LOST
from mnsf_ros.node.environment import advice_on_lost_clouds
from mnsf_ros.node.transforms import TransformError, Transforms
from mnsf_ros.settings import EgoMotionSettings, TimeSettings
from mnsf_ros.sweeps.rate_track import RateTrack, are_covered
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from msg_utils.errors import MessageError
from msg_utils.other_clouds import as_cloud

# Callbacks only decode and hand over, so waiting messages mean a short stall, not a queue.
_DEPTH = 5
# An IMU sends 200 messages and more a second, also while a cloud is decoded.
_TRACK_QOS: Final = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)

# The reliability is a parameter of its own, because it changes.
_OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH)

_MIN_RATES: Final = 2
# Clouds come more often, twice a second at least, and an IMU much more.
_SILENCE_S = 1.0

_MISSED = (
    CLOUDS_MISSED,
    "clouds were published that this node has not seen: lost in transport, or overwritten in its "
    "queue because the computer is too busy",
)

# Counts an event, which has happened as often as its optional last argument says, and logs its
# text now and then.
Report: TypeAlias = Callable[..., None]
Item = TypeVar("Item", bound=Stamped)


class MissedClouds:
    """Counts clouds that a queue has overwritten: it says nothing, but a publisher numbers them.

    The first cloud of a publisher is where its count begins: what it sent before was sent while it
    and the node had not found each other. With more than one publisher, or a middleware without
    numbers, there is no telling.
    """

    def __init__(self) -> None:
        self._last_number: int | None = None
        self._last_publishers = 0

    def before(self, number: int | None, num_publishers: int) -> int:
        """Returns how many clouds are missing between the last one and this one.

        Args:
            number: That the publisher gave the cloud, one more each time; None if it is not known.
            num_publishers: Those of the topic, as of now.
        """
        last, self._last_number = self._last_number, number
        is_one = max(num_publishers, self._last_publishers) <= 1
        self._last_publishers = num_publishers
        if number is None or last is None or not is_one:
            return 0
        # A publisher that starts anew begins at 1.
        return max(0, number - 1 - last)


class InputSubscription:
    """Subscribes best effort, or reliable where every publisher is; to clouds, or compressed ones.

    Reliable transport loses no large clouds, but a reliable subscription gets nothing from a
    best-effort publisher. `BEST_AVAILABLE` decides once, often before the publisher is there, so
    this looks again and again: call `refresh` from a timer.

    A topic that is neither remapped nor published is left for the only one with clouds.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        reliability: str,
        on_cloud: Callable[[PointCloud2], None],
        report: Report,
        *,
        may_search: bool = False,
    ) -> None:
        """Subscribes to a topic; with `may_search` it is one to leave."""
        self._node = node
        self._topic = topic
        self._wanted = reliability
        self._on_cloud = on_cloud
        self._report = report
        self._is_reliable = reliability == "reliable"
        self._class: Any = PointCloud2
        self._heard_s = -math.inf
        self._subscription = self._subscribe()
        is_named = self.topic != topic.replace("~", node.get_fully_qualified_name())
        self._search = CloudSearch(node) if may_search and not is_named else None

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
        """Publishers of the topic that are visible now."""
        return int(self._node.count_publishers(self.topic))

    @property
    def is_played(self) -> bool:
        """Whether a publisher of the topic is known to play recordings."""
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        return any(publisher.node_name in PLAYERS for publisher in publishers)

    @property
    def is_searching(self) -> bool:
        """Whether the only topic of clouds will be taken."""
        return self._search is not None

    @property
    def fault(self) -> str:
        """Why no sweep comes although the topic is published; empty if it is not published."""
        if time.monotonic() - self._heard_s < _SILENCE_S:
            return f"clouds of {self.topic} arrive, but make no sweep yet"
        return fault_of(self._node, self.topic, self._qos)

    def refresh(self) -> None:
        """Subscribes anew if the publishers offer another reliability or type."""
        offered = self._node.get_publishers_info_by_topic(self.topic)
        if offered:
            self._search = None
        else:
            self._missed = MissedClouds()
        if self._search is not None and (found := self._search.found()):
            self._node.get_logger().info(f"sweeps from {found}, the only topic of clouds")
            self._topic, self._search = found, None
            offered = self._node.get_publishers_info_by_topic(found)
        # Without publishers best effort, which suits whichever comes.
        all_reliable = bool(offered) and all(
            info.qos_profile.reliability == ReliabilityPolicy.RELIABLE for info in offered
        )
        is_reliable = all_reliable if self._wanted == "auto" else self._wanted == "reliable"
        kind = cloud_class({info.topic_type for info in offered}) or self._class
        wanted, topic = (is_reliable, kind), self._node.resolve_topic_name(self._topic)
        if (*wanted, topic) != (self._is_reliable, self._class, self.topic):
            self._is_reliable, self._class = wanted
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()
            self._node.get_logger().info(f"subscribed {self.reliability} to {self.topic}")

    @property
    def _qos(self) -> QoSProfile:
        policy = ReliabilityPolicy.RELIABLE if self._is_reliable else ReliabilityPolicy.BEST_EFFORT
        return QoSProfile(depth=_DEPTH, reliability=policy)

    def _subscribe(self) -> Any:  # noqa: ANN401 - rclpy's type differs between releases
        self._missed = MissedClouds()
        return self._node.create_subscription(
            self._class,
            self._topic,
            self._receive,
            self._qos,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )

    def _on_lost(self, event: Any) -> None:  # noqa: ANN401 - of rclpy
        text = f"clouds of {self.topic} are lost in transport: {advice_on_lost_clouds()}"
        self._report(SWEEPS_LOST, text, int(event.total_count_change))

    def _receive(self, message: PointCloud2, info: dict[str, Any]) -> None:
        self._heard_s = time.monotonic()
        number = info["publication_sequence_number"]
        missed = self._missed.before(number, self.num_publishers)
        if missed:
            self._report(*_MISSED, missed)
        self._on_cloud(message)


def decoded(
    clouds: CloudReader, message: PointCloud2, settings: TimeSettings, now_ns: int, report: Report
) -> Sweep | None:
    """Returns the sweep of a cloud; None if it cannot be decoded or has no points, as reported."""
    try:
        sweep = clouds.sweep(as_cloud(message), settings, now_ns)
    except MessageError as error:
        report(CLOUDS_UNDECODABLE, f"a cloud cannot be decoded: {error}")
        return None
    if not sweep.source.is_stamped:
        report("clouds_without_stamp", "a cloud has no stamp; its time of arrival is used")
    if len(sweep) == 0:
        report(CLOUDS_EMPTY, "a cloud without a measured point is skipped")
        return None
    if fault := sweep.source.times.fault:
        text = f"the times of points are not used: {fault}"
        report("clouds_without_usable_times", text)
    if num_untimed := sweep.source.num_untimed:
        text = "points are left out whose time cannot be right (lost packets?)"
        report("points_without_usable_time", text, num_untimed)
    return sweep


class TrackSubscription(Generic[Item]):
    """Remembers stamped messages of a topic while they are wanted; counts those that are skipped.

    Attributes:
        track: What is remembered.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        message_type: type[Any],
        decode: Callable[[Any], Item],
        report: Report,
    ) -> None:
        """Remembers nothing yet; `decode` raises MessageError for messages that are skipped."""
        self._node, self._topic, self._message_type = node, topic, message_type
        self._decode, self._report = decode, report
        self._name = topic.removeprefix("~/")
        self._heard_s = -math.inf
        self._subscription: Any = None

    @property
    def silence_s(self) -> float:
        """Seconds since the last message, whatever its stamp."""
        return time.monotonic() - self._heard_s

    def remember(self, track: StampedTrack[Item], *, is_wanted: bool) -> None:
        """Remembers in another track from now on; subscribes if messages are wanted."""
        self.track = track
        if is_wanted and self._subscription is None:
            self._subscription = self._node.create_subscription(
                self._message_type, self._topic, self._on_message, _TRACK_QOS
            )
        elif not is_wanted and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _on_message(self, message: Any) -> None:  # noqa: ANN401 - of any type
        self._heard_s = time.monotonic()
        try:
            item = self._decode(message)
        except MessageError as error:
            self._report(
                f"{self._name}_undecodable", f"a message on {self._topic} is skipped: {error}"
            )
            return
        if not self.track.add(item):
            text = f"a message on {self._topic} is skipped: its stamp is not after the last one"
            self._report(f"{self._name}_out_of_order", text)


class OdometryInput:
    """Remembers odometry, and adds the pose of the sensor to sweeps."""

    def __init__(self, node: Node, report: Report) -> None:
        self._messages = TrackSubscription(node, "~/odometry", Odometry, StampedPose.of, report)
        self._transforms: Transforms | None = None
        self._track = PoseTrack()

    def change_settings(self, settings: EgoMotionSettings, transforms: Transforms | None) -> None:
        """Applies other settings, subscribes or unsubscribes; earlier poses are forgotten.

        `transforms` have the pose of the sensor on the robot, if the settings ask for them.
        """
        self._transforms = transforms if settings.sensor_pose == "tf" else None
        self._track = PoseTrack(mount=None if self._transforms else sensor_mount(settings))
        self._messages.remember(self._track, is_wanted=settings.source == "odometry")

    def located(self, sweep: Sweep) -> Sweep:
        """Returns the sweep with the sensor's pose by odometry, if that is known.

        Raises:
            TransformError: If the pose of the sensor on the robot is unknown.
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


class ImuInput:
    """Remembers the turn rates of an IMU, and adds them to sweeps."""

    def __init__(self, node: Node, report: Report) -> None:
        self._node, self._report = node, report
        self._messages = TrackSubscription(node, "~/imu", Imu, StampedRate.of, report)
        self._track = RateTrack()
        # Only an IMU of another frame than the clouds needs them.
        self._transforms: Transforms | None = None

    def change_settings(self, settings: EgoMotionSettings) -> None:
        """Applies other settings, subscribes or unsubscribes; earlier rates are forgotten."""
        self._track = RateTrack()
        self._messages.remember(self._track, is_wanted=settings.imu)

    @property
    def text(self) -> str:
        """Frame and rate, or silence, in words."""
        frame_id, rate_hz = self._track.frame_id, self._track.rate_hz
        if not rate_hz:
            return "none"
        silence_s = self._messages.silence_s
        text = f"{rate_hz:.0f} Hz" if silence_s < _SILENCE_S else f"silent for {silence_s:.0f} s"
        return f"{text}, frame {frame_id!r}"

    def turning(self, sweep: Sweep) -> Sweep:
        """Returns the sweep with its turn rates, if they and the rotation of the IMU are known."""
        if len(self._track) < _MIN_RATES:
            return sweep
        rates = self._track.around(sweep)
        if not are_covered(rates, *sweep.span_s):
            text = "turn rates of the IMU are late, have gaps, or have stamps of another clock"
            self._report("sweeps_without_turn_rates", text)
        try:
            return sweep.turning(rates, self._sensor_from_imu(sweep.frame_id, self._track.frame_id))
        except (TransformError, SettingsError) as error:
            self._report("imu_without_transform", f"{error}; the IMU is ignored")
            return sweep

    def _sensor_from_imu(self, sensor: str, imu: str) -> Floats:
        if sensor.lstrip("/") == imu.lstrip("/"):
            return np.eye(4)
        if self._transforms is None:
            self._transforms = Transforms(self._node, f"an IMU in the frame {imu!r}")
        return self._transforms.find(sensor, imu)
