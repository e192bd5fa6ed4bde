# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Plays a recording to the live node at its recorded pace and records the flow."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from mnsf_ros.demo.node_process import NodeProcess
from mnsf_ros.demo.pace import in_time
from mnsf_ros.demo.replay_link import DIAGNOSTICS_TYPE, MARKERS_TYPE, ReceivedFlow, ReplayLink
from mnsf_ros.online.online_pipeline import TRIPLET_ENDS
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.ros1_file import jazzy
from msg_utils.stamps import decode_stamp

POINTS_TOPIC = "/scene_flow/points"
FLOW_TOPIC = "/scene_flow/flow"
DIAGNOSTICS_TOPIC = "/diagnostics"
MARKERS_TOPIC = "/scene_flow/objects/markers"

_START_TIMEOUT_S = 120.0
_LAST_FLOW_TIMEOUT_S = 120.0


@dataclass
class ReplayLog:
    """Sweeps and flows of a replay, and the node's own figures.

    Attributes:
        published_s: Stamp of a sweep -> `time.monotonic()` of its publication, in that order.
        arrived_s: Stamp of a sweep -> `time.monotonic()` of the arrival of its flow.
        counts: Event -> number, as counted on /diagnostics.
        last_failure: Text of the last failed estimate on /diagnostics.
        estimate_ms: Median time of an estimate on /diagnostics; NaN if unknown.
    """

    published_s: dict[int, float] = field(default_factory=dict)
    arrived_s: dict[int, float] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    last_failure: str = "unknown"
    estimate_ms: float = math.nan

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
    log = ReplayLog()

    def on_flow(flow: ReceivedFlow) -> None:
        if flow.stamp_ns not in log.published_s:
            return
        log.arrived_s[flow.stamp_ns] = flow.arrived_s
        writer.write_raw(FLOW_TOPIC, CLOUD_TYPE, flow.stamp_ns, flow.raw)

    def on_diagnostics(raw: bytes) -> None:
        # As if received when the newest sweep was measured: viewers then show both together.
        if log.published_s:
            writer.write_raw(DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, max(log.published_s), raw)

    def on_markers(raw: bytes) -> None:
        message: Any = jazzy().deserialize_cdr(raw, MARKERS_TYPE)
        stamps = {decode_stamp(marker.header.stamp) for marker in message.markers[:1]}
        for stamp_ns in stamps.intersection(log.published_s):
            writer.write_raw(MARKERS_TOPIC, MARKERS_TYPE, stamp_ns, raw)

    def is_complete() -> bool:
        log.counts = link.counts
        return log.is_complete

    names = [namespace + name for name in (POINTS_TOPIC, FLOW_TOPIC, DIAGNOSTICS_TOPIC)]
    with ReplayLink(names[0], names[1], on_flow, on_diagnostics, names[2]) as link:
        link.subscribe(namespace + MARKERS_TOPIC, MARKERS_TYPE, on_markers)
        if not link.wait_until(lambda: link.is_connected, node, _START_TIMEOUT_S):
            raise node.failure(f"the node was not there after {_START_TIMEOUT_S:.0f} s")
        messages = reader.raw_messages(topic)
        for _, raw in in_time(messages, link.spin_for, clock=time.monotonic):
            node.check()
            published_s = time.monotonic()
            log.published_s[link.publish(raw)] = published_s
            progress(len(log.published_s), len(log.arrived_s))
        link.settle(node, lambda: len(log.arrived_s), _LAST_FLOW_TIMEOUT_S, is_complete)
        progress(len(log.published_s), len(log.arrived_s))
        log.last_failure = link.flow_values.get("last failure", log.last_failure)
        log.estimate_ms = float(link.flow_values.get("estimate median [ms]", math.nan))
    return log
