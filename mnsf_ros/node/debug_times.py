"""How long the node takes, as numbers that can be plotted."""

from __future__ import annotations

import time

from rclpy.node import Node
from std_msgs.msg import Float64


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
