"""The robot's side of the node's topics: publishes sweeps, receives flow and diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from msg_utils.stamps import decode_stamp

FLOW_STATUS = ": flow"


@dataclass(frozen=True)
class ReceivedFlow:
    """A flow cloud as it arrived."""

    stamp_ns: int  # of the sweep that it belongs to
    arrived_s: float  # `time.monotonic()`
    raw: bytes  # the serialized message


class ReplayLink:
    """A ROS node of its own context, driven by the caller: nothing happens outside of `spin_for`.

    Use it as a context manager.

    Attributes:
        flow_values: Key to value of the node's latest `flow` status on /diagnostics.
        counts: Event to how often it happened, in the node's latest message on /diagnostics.
        num_statuses: Messages of the node on /diagnostics so far.
    """

    def __init__(
        self,
        points_topic: str,
        flow_topic: str,
        on_flow: Callable[[ReceivedFlow], None],
        on_diagnostics: Callable[[bytes], None],
    ) -> None:
        """Joins the ROS graph; `on_diagnostics` gets each serialized message on /diagnostics."""
        self._on_flow = on_flow
        self._on_diagnostics = on_diagnostics
        self.flow_values: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.num_statuses = 0
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("mnsf_replay", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        reliable = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
        self._publisher = self._node.create_publisher(PointCloud2, points_topic, reliable)
        self._flow = self._node.create_subscription(
            PointCloud2, flow_topic, self._receive_flow, reliable, raw=True
        )
        self._node.create_subscription(
            DiagnosticArray, "/diagnostics", self._receive_diagnostics, 10, raw=True
        )

    def __enter__(self) -> ReplayLink:
        """Returns itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Leaves the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    @property
    def is_connected(self) -> bool:
        """Whether the scene flow node listens and will be heard."""
        return self.is_heard and bool(self._node.count_publishers(self._flow.topic_name))

    @property
    def is_heard(self) -> bool:
        """Whether the scene flow node listens."""
        return bool(self._publisher.get_subscription_count() > 0)

    def publish(self, raw: bytes) -> int:
        """Publishes a serialized cloud; returns the stamp in its header, nanoseconds.

        Raises:
            MessageError: If the stamp is no time.
        """
        stamp_ns = decode_stamp(deserialize_message(raw, PointCloud2).header.stamp)
        self._publisher.publish(raw)
        return stamp_ns

    def publish_bytes(self, raw: bytes) -> None:
        """Publishes bytes as they are, also those that are no cloud."""
        self._publisher.publish(raw)

    def spin_for(self, duration_s: float) -> None:
        """Handles what arrives during some time."""
        deadline_s = time.monotonic() + duration_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left_s)

    def _receive_flow(self, raw: bytes) -> None:
        arrived_s = time.monotonic()
        stamp_ns = decode_stamp(deserialize_message(raw, PointCloud2).header.stamp)
        self._on_flow(ReceivedFlow(stamp_ns, arrived_s, raw))

    def _receive_diagnostics(self, raw: bytes) -> None:
        statuses = deserialize_message(raw, DiagnosticArray).status
        values = [
            {item.key: item.value for item in status.values}
            for status in statuses
            if status.name.endswith(FLOW_STATUS)
        ]
        if values:
            self.flow_values = values[-1]
            self.num_statuses += 1
            self.counts = {
                item.key: int(item.value)
                for status in statuses
                for item in status.values
                if item.value.isdigit() and " " not in item.key
            }
        self._on_diagnostics(raw)
