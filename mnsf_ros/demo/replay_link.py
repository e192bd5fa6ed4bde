# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The robot's side of a node: it publishes sweeps, and receives flow and diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from mnsf_ros.demo.node_process import NodeProcess
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.ros1_file import jazzy
from msg_utils.cdr import serialized_stamp_ns

DIAGNOSTICS_TYPE: Final = "diagnostic_msgs/msg/DiagnosticArray"
MARKERS_TYPE: Final = "visualization_msgs/msg/MarkerArray"

_FLOW_STATUS: Final = ": flow"
# After so many messages on /diagnostics without any change nothing more is expected.
_QUIET_STATUSES: Final = 5
_ROUND_S: Final = 0.1


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
        points: Publisher of the sweeps; it takes any bytes.
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
        self._on_flow, self._on_diagnostics = on_flow, on_diagnostics
        self.flow_values: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.num_statuses = 0
        self.points = self.publisher(points_topic, CLOUD_TYPE)
        self._flow_topic = flow_topic
        self.subscribe(flow_topic, CLOUD_TYPE, self._receive_flow)
        self.subscribe(diagnostics_topic, DIAGNOSTICS_TYPE, self._receive_diagnostics, depth=10)

    @property
    def is_connected(self) -> bool:
        """Whether the node and this process see each other."""
        is_seen = self.is_heard and self.num_publishers(self._flow_topic) > 0
        # The node works only for subscribers that it sees; its diagnostics arrive once it does.
        return is_seen and self.num_statuses > 0

    @property
    def is_heard(self) -> bool:
        """Whether the node subscribes to the sweeps."""
        return bool(self.points.get_subscription_count() > 0)

    def publish(self, raw: bytes) -> int:
        """Publishes a serialized cloud; returns the stamp in its header, nanoseconds."""
        self.points.publish(raw)
        return serialized_stamp_ns(raw)

    def wait_until(self, is_done: Callable[[], bool], node: NodeProcess, timeout_s: float) -> bool:
        """Handles messages until something is done; False if it is not done in time.

        Raises:
            NodeProcessError: If the node ends.
        """
        deadline_s = time.monotonic() + timeout_s
        while not is_done():
            node.check()
            if time.monotonic() > deadline_s:
                return False
            self.spin_for(_ROUND_S)
        return True

    def settle(
        self,
        node: NodeProcess,
        num_flows: Callable[[], int],
        timeout_s: float,
        is_complete: Callable[[], bool] = lambda: False,
    ) -> None:
        """Waits until all is complete, or the node is idle and nothing changes any more.

        An idle node is not enough: the latest diagnostics may be from before the last sweep, and a
        published flow may still be under way.

        Raises:
            NodeProcessError: If the node ends.
        """
        last: tuple[dict[str, int], int] | None = None
        num_before = 0

        def is_settled() -> bool:
            nonlocal last, num_before
            now = (self.counts, num_flows())
            if now != last:
                last, num_before = now, self.num_statuses
            is_quiet = self.num_statuses - num_before >= _QUIET_STATUSES
            return is_complete() or (is_quiet and self.flow_values.get("busy") == "False")

        self.wait_until(is_settled, node, timeout_s)

    def _receive_flow(self, raw: bytes) -> None:
        self._on_flow(ReceivedFlow(serialized_stamp_ns(raw), time.monotonic(), raw))

    def _receive_diagnostics(self, raw: bytes) -> None:
        message: Any = jazzy().deserialize_cdr(raw, DIAGNOSTICS_TYPE)
        values = [
            {item.key: item.value for item in status.values}
            for status in message.status
            if status.name.endswith(_FLOW_STATUS)
        ]
        if values:
            self.flow_values = values[-1]
            self.num_statuses += 1
            self.counts = {
                item.key: int(item.value)
                for status in message.status
                for item in status.values
                if item.value.isdigit() and " " not in item.key
            }
        self._on_diagnostics(raw)
