# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The output topics of an estimate, and its times."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import visualization_msgs.msg
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64, Header, String
from visualization_msgs.msg import MarkerArray

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.ego_motion.covariance import UNKNOWN_COVARIANCE
from mnsf_ros.geometry.transforms import pose_quaternion
from mnsf_ros.node.object_messages import (
    MessageMaker,
    cloud_of,
    installed_messages,
    objects_cloud,
)
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import flow_cloud
from mnsf_ros.sweeps_io.movers_at_stamp import moving_cloud
from mnsf_ros.sweeps_io.object_markers import objects_markers
from mnsf_ros.sweeps_io.predicted_ground import clearing_columns, predicted_columns

_DEFAULT = Settings()


class FlowOutputs:
    """`~/flow` with all points, parts of it, `~/ego_motion`, `~/predicted`, and `~/objects`.

    rcl allows publishing from any thread; a thread of the pipeline does it.
    """

    def __init__(self, node: Node, odom_frame: str) -> None:
        """Advertises the topics; the poses of `~/ego_motion` are in `odom_frame`."""
        self._odom_frame = odom_frame
        output = partial(_output, node)
        self._flow = output(PointCloud2, "~/flow")
        self._moving = output(PointCloud2, "~/flow/moving")
        self._standing = output(PointCloud2, "~/flow/standing")
        self._predicted = output(PointCloud2, "~/predicted")
        self._clearing = output(PointCloud2, "~/predicted/clearing")
        self._ego_motion = output(Odometry, "~/ego_motion", depth=10)
        self._source = output(String, "~/ego_motion/source", is_latched=True)
        markers: MessageMaker = partial(objects_markers, visualization_msgs.msg)
        self._objects = [
            (output(message_type, topic), make)
            for topic, message_type, make in (
                ("~/objects", PointCloud2, objects_cloud),
                ("~/objects/markers", MarkerArray, markers),
                *installed_messages(),
            )
        ]
        self._last_source = ""

    @property
    def topic(self) -> str:
        """Full name of the topic with all points."""
        return str(self._flow.topic_name)

    @property
    def are_watched(self) -> bool:
        """Whether any output has a subscriber."""
        outputs = [self._flow, self._moving, self._standing, self._predicted, self._clearing]
        outputs += [self._ego_motion, self._source, *(output for output, _ in self._objects)]
        return any(output.get_subscription_count() > 0 for output in outputs)

    def publish(
        self, triplet: SweepTriplet, estimate: FlowEstimate, settings: Settings = _DEFAULT
    ) -> None:
        """Publishes the flow of the triplet's current sweep on all topics with subscribers."""
        sweep, interval_s, known = triplet.current, triplet.interval_s, estimate.over_ground
        header, output = sweep.source.message.header, settings.output
        cloud = partial(flow_cloud, sweep, estimate, interval_s, output)
        _send(self._flow, cloud)
        if known is None:
            return
        _send(self._standing, lambda: cloud(~known.dynamic))
        _send(self._moving, partial(moving_cloud, triplet, estimate, known, settings))
        motion = partial(ego_motion_message, header, self._odom_frame, known, interval_s)
        _send(self._ego_motion, motion)
        if known.source != self._last_source:
            self._last_source = known.source
            self._source.publish(String(data=known.source))
        if known.track_ids is None:
            return
        for publisher, make in self._objects:
            _send(publisher, partial(make, header, known.objects))
        if known.lost:
            # Where objects are now is not known: costmaps keep what was marked last.
            return
        predicted = partial(predicted_columns, known.objects, output.horizon_s)
        _send(self._predicted, lambda: cloud_of(header, predicted()))
        _send(self._clearing, lambda: cloud_of(header, clearing_columns(sweep.mounting)))


class DebugTimes:
    """`~/debug/...` in milliseconds, one message for each flow."""

    def __init__(self, node: Node) -> None:
        self._processing, self._latency, self._cycle = (
            node.create_publisher(Float64, f"~/debug/{name}_ms", 1)
            for name in ("processing_time", "pipeline_latency", "cyclic_time")
        )
        self._last_s: float | None = None

    def publish(self, processing_ms: float, arrived_ns: int) -> None:
        """Publishes the times of a flow that has just been published.

        Args:
            processing_ms: Time of the estimate.
            arrived_ns: `time.monotonic_ns()` of the arrival of the newest sweep in it.
        """
        now_s = time.monotonic()
        self._processing.publish(Float64(data=processing_ms))
        self._latency.publish(Float64(data=1e3 * now_s - arrived_ns / 1e6))
        if self._last_s is not None:
            self._cycle.publish(Float64(data=1e3 * (now_s - self._last_s)))
        self._last_s = now_s


def _output(
    node: Node, message_type: type, topic: str, *, depth: int = 1, is_latched: bool = False
) -> Publisher:
    """A reliable publisher, whose quality of service the user may change."""
    kept = DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=kept)
    overriding = QoSOverridingOptions.with_default_policies()
    return node.create_publisher(message_type, topic, qos, qos_overriding_options=overriding)


def _send(publisher: Publisher, make: Callable[[], Any]) -> None:
    """Publishes what `make` returns, if anybody listens; else it is not made."""
    if publisher.get_subscription_count() > 0:
        publisher.publish(make())


def ego_motion_message(
    header: Header, odom_frame: str, known: OverGround, interval_s: float
) -> Odometry:
    """Returns the pose and the twist of the sensor at a sweep, with the header of its cloud.

    The pose is in `odom_frame`, the sensor frame of the first sweep; the twist in the sensor's own
    frame, 0 and unknown unless the interval to the next sweep is positive.
    """
    message = Odometry(child_frame_id=header.frame_id)
    message.header.stamp = header.stamp
    message.header.frame_id = odom_frame
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = known.world_from_sensor[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = pose_quaternion(known.world_from_sensor)
    pose_covariance, twist_covariance = known.pose_covariance, None
    if interval_s > 0:
        # The static world moves the other way.
        current_from_next = np.linalg.inv(known.next_from_current)
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        linear.x, linear.y, linear.z = (current_from_next[:3, 3] / interval_s).tolist()
        rotation = Rotation.from_matrix(current_from_next[:3, :3]).as_rotvec()
        angular.x, angular.y, angular.z = (rotation / interval_s).tolist()
        if known.motion_covariance is not None:
            twist_covariance = known.motion_covariance / interval_s**2
    for part, covariance in ((message.pose, pose_covariance), (message.twist, twist_covariance)):
        part.covariance = (UNKNOWN_COVARIANCE if covariance is None else covariance).ravel()
    return message
