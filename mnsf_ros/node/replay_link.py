# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The robot's side of the node's topics: publishes sweeps, receives flow and diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from mnsf_ros.node.raw_topics import RawTopics
from msg_utils.stamps import decode_stamp

FLOW_STATUS = ": flow"


@dataclass(frozen=True)
class ReceivedFlow:
    """A flow cloud as it arrived."""

    stamp_ns: int  # of the sweep that it belongs to
    arrived_s: float  # `time.monotonic()`
    raw: bytes  # the serialized message


class ReplayLink(RawTopics):
    """Publishes sweeps to the node and receives its messages.

    Attributes:
        flow_values: Key -> value of the latest `flow` status on /diagnostics.
        counts: Event -> number in the latest message on /diagnostics.
        num_statuses: Number of messages on /diagnostics so far.
    """

    def __init__(
        self,
        points_topic: str,
        flow_topic: str,
        on_flow: Callable[[ReceivedFlow], None],
        on_diagnostics: Callable[[bytes], None],
        diagnostics_topic: str = "/diagnostics",
    ) -> None:
        """Joins the ROS graph; `on_diagnostics` gets each serialized message of diagnostics."""
        super().__init__("mnsf_replay")
        self._on_flow = on_flow
        self._on_diagnostics = on_diagnostics
        self.flow_values: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.num_statuses = 0
        self._publisher = self.publisher(points_topic, "sensor_msgs/msg/PointCloud2")
        self._flow_topic = flow_topic
        self.subscribe(flow_topic, "sensor_msgs/msg/PointCloud2", self._receive_flow)
        self.subscribe(
            diagnostics_topic,
            "diagnostic_msgs/msg/DiagnosticArray",
            self._receive_diagnostics,
            depth=10,
        )

    def watch_markers(self, topic: str, on_markers: Callable[[int, bytes], None]) -> None:
        """Calls `on_markers` with stamp and bytes of each message that has markers."""

        def receive(raw: bytes) -> None:
            markers = deserialize_message(raw, MarkerArray).markers
            if markers:
                on_markers(decode_stamp(markers[0].header.stamp), raw)

        self.subscribe(topic, "visualization_msgs/msg/MarkerArray", receive)

    @property
    def is_connected(self) -> bool:
        """Whether the node and this process see each other."""
        is_seen = self.is_heard and self.num_publishers(self._flow_topic) > 0
        # The node works only for subscribers that it sees; its diagnostics arrive once it does.
        return is_seen and self.num_statuses > 0

    @property
    def is_heard(self) -> bool:
        """Whether the node subscribes to the sweeps."""
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
        """Publishes any bytes, also those of no cloud."""
        self._publisher.publish(raw)

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
