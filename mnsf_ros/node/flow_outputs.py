"""What the node publishes of an estimate."""

from __future__ import annotations

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.node.cloud_messages import CloudSource, flow_message, part_message
from mnsf_ros.node.pose_messages import ego_motion_message
from mnsf_ros.sweeps.sweep import SweepTriplet


class FlowOutputs:
    """`~/flow` with all points, `~/flow/moving` and `~/flow/standing` with some, `~/ego_motion`.

    rcl allows publishing from any thread; the worker thread of the pipeline does it.
    """

    def __init__(self, node: Node) -> None:
        """Makes the publishers."""
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._flow = node.create_publisher(PointCloud2, "~/flow", reliable)
        self._moving = node.create_publisher(PointCloud2, "~/flow/moving", reliable)
        self._standing = node.create_publisher(PointCloud2, "~/flow/standing", reliable)
        self._ego_motion = node.create_publisher(Odometry, "~/ego_motion", 10)
        self._source = node.create_publisher(String, "~/ego_motion/source", latched)
        self._last_source = ""

    @property
    def topic(self) -> str:
        """Full name of the topic with all points."""
        return str(self._flow.topic_name)

    @property
    def are_watched(self) -> bool:
        """Whether anybody subscribes to any of it."""
        outputs = (self._flow, self._moving, self._standing, self._ego_motion, self._source)
        return any(output.get_subscription_count() > 0 for output in outputs)

    def publish(self, triplet: SweepTriplet, estimate: FlowEstimate) -> None:
        """Publishes the flow of the triplet's current sweep."""
        sweep, interval_s = triplet.current, triplet.interval_s
        message = flow_message(sweep, estimate, interval_s)
        self._flow.publish(message)
        known = estimate.over_ground
        if known is None:
            return
        for output, wanted in ((self._moving, known.dynamic), (self._standing, ~known.dynamic)):
            if output.get_subscription_count() > 0:
                output.publish(part_message(sweep, message, wanted))
        source: CloudSource = sweep.source
        self._ego_motion.publish(ego_motion_message(source.message.header, known, interval_s))
        if known.source != self._last_source:
            self._last_source = known.source
            self._source.publish(String(data=known.source))
