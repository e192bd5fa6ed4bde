# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Plays a recording to the live node at its recorded pace and records the flow."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

from mnsf_ros.demo.node_process import NodeProcess
from mnsf_ros.demo.play import in_time
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.online.online_pipeline import TRIPLET_ENDS
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.ros1_file import jazzy
from msg_utils.cdr import serialized_stamp_ns
from msg_utils.stamps import decode_stamp

POINTS_TOPIC: Final = "/scene_flow/points"
FLOW_TOPIC: Final = "/scene_flow/flow"
DIAGNOSTICS_TOPIC: Final = "/diagnostics"
MARKERS_TOPIC: Final = "/scene_flow/objects/markers"
_DIAGNOSTICS_TYPE: Final = "diagnostic_msgs/msg/DiagnosticArray"
_MARKERS_TYPE: Final = "visualization_msgs/msg/MarkerArray"

_TIMEOUT_S: Final = 120.0  # for the start of the node, and for its last flow
_FLOW_STATUS: Final = ": flow"
# After so many messages on /diagnostics without any change nothing more is expected.
_QUIET_STATUSES: Final = 5
_ROUND_S: Final = 0.1


@dataclass
class ReplayLog:
    """Sweeps and flows of a replay, and the node's own figures.

    Attributes:
        published_s: Stamp of a sweep -> `time.monotonic()` of its publication, in that order.
        arrived_s: Stamp of a sweep -> `time.monotonic()` of the arrival of its flow.
        counts: Event -> number, as counted in the latest message on /diagnostics.
        values: Key -> value of the latest `flow` status there.
    """

    published_s: dict[int, float] = field(default_factory=dict)
    arrived_s: dict[int, float] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    values: Mapping[str, str] = field(default_factory=dict)

    @property
    def num_possible(self) -> int:
        """Number of sweeps with one before and one after them, which can have a flow."""
        return max(len(self.published_s) - 2, len(self.arrived_s))

    @property
    def interval_ms(self) -> float:
        """Median interval of the stamps of sweeps; NaN for less than two."""
        intervals_ns = [after - before for before, after in pairwise(self.published_s)]
        return statistics.median(intervals_ns) / 1e6 if intervals_ns else math.nan

    @property
    def estimate_ms(self) -> float:
        """Median time of an estimate; NaN if unknown."""
        return float(self.values.get("estimate median [ms]", math.nan))

    @property
    def latencies_ms(self) -> list[float]:
        """From the publication of sweep t+1 to the arrival of the flow of t, for each flow."""
        stamps = list(self.published_s)
        following = dict(pairwise(stamps))
        return [
            (arrived_s - self.published_s[following[stamp]]) * 1e3
            for stamp, arrived_s in self.arrived_s.items()
            if stamp in following
        ]

    @property
    def num_dropped(self) -> int:
        """Triplets that a newer one replaced before their turn."""
        return self.counts.get("triplets_dropped", 0)

    @property
    def losses(self) -> dict[str, int]:
        """Other reasons for sweeps without flow, with their numbers."""
        counts = self.counts
        return {
            "failed estimates": counts.get("estimates_failed", 0),
            "sweeps lost in transport": len(self.published_s) - _num_received(counts),
            "flows lost in transport": counts.get("flows_out", 0) - len(self.arrived_s),
        }

    @property
    def is_complete(self) -> bool:
        """Whether the node has counted every sweep, and all its flows have arrived."""
        counts = self.counts
        num_done = sum(counts.get(event, 0) for event in TRIPLET_ENDS)
        return (
            _num_received(counts) >= len(self.published_s)
            and num_done >= counts.get("triplets_formed", 0)
            and len(self.arrived_s) >= counts.get("flows_out", 0)
        )


def _num_received(counts: Mapping[str, int]) -> int:
    events = ("sweeps_received", "clouds_undecodable", "clouds_empty")
    return sum(counts.get(event, 0) for event in events)


class ReplayLink(RawTopics):
    """The robot's side of a node: publishes sweeps, receives flow and diagnostics.

    Attributes:
        log: What has happened so far.
        points: Publisher of the sweeps; it takes any bytes.
        num_statuses: Number of messages on /diagnostics so far.
    """

    def __init__(
        self,
        points_topic: str,
        flow_topic: str,
        on_flow: Callable[[int, bytes], None] = lambda stamp_ns, raw: None,
        on_diagnostics: Callable[[bytes], None] = lambda raw: None,
        diagnostics_topic: str = DIAGNOSTICS_TOPIC,
    ) -> None:
        """Joins the ROS graph.

        Args:
            points_topic: Of the sweeps.
            flow_topic: Of the node's flow.
            on_flow: Gets the stamp of a published sweep and its serialized flow.
            on_diagnostics: Gets each serialized message of diagnostics.
            diagnostics_topic: Of the node.
        """
        super().__init__("mnsf_replay")
        self._on_flow, self._on_diagnostics = on_flow, on_diagnostics
        self.log = ReplayLog()
        self.num_statuses = 0
        self.points = self.publisher(points_topic, CLOUD_TYPE)
        self._flow_topic = flow_topic
        self.subscribe(flow_topic, CLOUD_TYPE, self._receive_flow)
        self.subscribe(diagnostics_topic, _DIAGNOSTICS_TYPE, self._receive_diagnostics, depth=10)

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

    def publish(self, raw: bytes) -> None:
        """Publishes a serialized cloud."""
        published_s = time.monotonic()
        self.points.publish(raw)
        self.log.published_s[serialized_stamp_ns(raw)] = published_s

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
        timeout_s: float = _TIMEOUT_S,
        is_complete: Callable[[], bool] = lambda: False,
    ) -> None:
        """Waits until all is complete, or the node is idle and nothing changes any more.

        An idle node is not enough: the latest diagnostics may be from before the last sweep, and a
        published flow may still be under way.

        Raises:
            NodeProcessError: If the node ends.
        """
        last: tuple[Mapping[str, int], int] | None = None
        num_before = 0

        def is_settled() -> bool:
            nonlocal last, num_before
            now = (self.log.counts, len(self.log.arrived_s))
            if now != last:
                last, num_before = now, self.num_statuses
            is_quiet = self.num_statuses - num_before >= _QUIET_STATUSES
            return is_complete() or (is_quiet and self.log.values.get("busy") == "False")

        self.wait_until(is_settled, node, timeout_s)

    def _receive_flow(self, raw: bytes) -> None:
        stamp_ns = serialized_stamp_ns(raw)
        if stamp_ns in self.log.published_s:
            self.log.arrived_s[stamp_ns] = time.monotonic()
            self._on_flow(stamp_ns, raw)

    def _receive_diagnostics(self, raw: bytes) -> None:
        message: Any = jazzy().deserialize_cdr(raw, _DIAGNOSTICS_TYPE)
        values = [
            {item.key: item.value for item in status.values}
            for status in message.status
            if status.name.endswith(_FLOW_STATUS)
        ]
        if values:
            self.log.values = values[-1]
            self.num_statuses += 1
            self.log.counts = {
                item.key: int(item.value)
                for status in message.status
                for item in status.values
                if item.value.isdigit() and " " not in item.key
            }
        self._on_diagnostics(raw)


def replay(
    reader: BagReader,
    topic: str,
    node: NodeProcess,
    writer: BagWriter,
    progress: Callable[[int, int], None],
    namespace: str = "",
) -> ReplayLog:
    """Publishes all sweeps of a topic, records the node's messages, waits for the last flow.

    `progress` is called with the numbers of sweeps published and of flows received. All topics
    of the node are in the namespace, also /diagnostics; they are recorded without it.

    Raises:
        RecordingError: If the recording is damaged.
        NodeProcessError: If the node ends or does not come up.
    """

    def on_flow(stamp_ns: int, raw: bytes) -> None:
        writer.write_raw(FLOW_TOPIC, CLOUD_TYPE, stamp_ns, raw)

    def on_diagnostics(raw: bytes) -> None:
        # As if received when the newest sweep was measured: viewers then show both together.
        if link.log.published_s:
            newest_ns = max(link.log.published_s)
            writer.write_raw(DIAGNOSTICS_TOPIC, _DIAGNOSTICS_TYPE, newest_ns, raw)

    def on_markers(raw: bytes) -> None:
        message: Any = jazzy().deserialize_cdr(raw, _MARKERS_TYPE)
        stamps = {decode_stamp(marker.header.stamp) for marker in message.markers[:1]}
        for stamp_ns in stamps.intersection(link.log.published_s):
            writer.write_raw(MARKERS_TOPIC, _MARKERS_TYPE, stamp_ns, raw)

    names = [namespace + name for name in (POINTS_TOPIC, FLOW_TOPIC, DIAGNOSTICS_TOPIC)]
    with ReplayLink(names[0], names[1], on_flow, on_diagnostics, names[2]) as link:
        log = link.log
        link.subscribe(namespace + MARKERS_TOPIC, _MARKERS_TYPE, on_markers)
        if not link.wait_until(lambda: link.is_connected, node, _TIMEOUT_S):
            raise node.failure(f"the node was not there after {_TIMEOUT_S:.0f} s")
        messages = reader.raw_messages(topic)
        for _, raw in in_time(messages, link.spin_for, clock=time.monotonic):
            node.check()
            link.publish(raw)
            progress(len(log.published_s), len(log.arrived_s))
        link.settle(node, is_complete=lambda: log.is_complete)
        progress(len(log.published_s), len(log.arrived_s))
    return log
