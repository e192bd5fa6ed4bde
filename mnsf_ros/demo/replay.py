"""Plays a recording to the live node at its recorded pace and records the flow."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise

from mnsf_ros.demo.node_process import NodeProcess
from mnsf_ros.node.replay_link import ReceivedFlow, ReplayLink
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.conventions import CLOUD_TYPE

POINTS_TOPIC = "/scene_flow/points"
FLOW_TOPIC = "/scene_flow/flow"
DIAGNOSTICS_TOPIC = "/diagnostics"

_START_TIMEOUT_S = 120.0
_LAST_FLOW_TIMEOUT_S = 120.0
_NANOSECONDS = 1e9


@dataclass
class ReplayLog:
    """What happened during a replay.

    Attributes:
        published_s: Stamp of a sweep to `time.monotonic()` of its publication, in that order.
        arrived_s: Stamp of a sweep to `time.monotonic()` of the arrival of its flow.
        node_values: What the node said of itself at the end, from /diagnostics.
    """

    published_s: dict[int, float] = field(default_factory=dict)
    arrived_s: dict[int, float] = field(default_factory=dict)
    node_values: dict[str, str] = field(default_factory=dict)

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


def replay(
    reader: BagReader,
    topic: str,
    node: NodeProcess,
    writer: BagWriter,
    progress: Callable[[int, int], None],
) -> ReplayLog:
    """Publishes all sweeps of a topic and waits for the last flow.

    Args:
        reader: The open recording.
        topic: Topic of its point clouds.
        node: The running node.
        writer: Gets the flow and the diagnostics.
        progress: Called with the numbers of sweeps published and of flows received.

    Raises:
        RecordingError: If damage is met in the recording.
        NodeProcessError: If the node ends or does not come up.
    """
    log = ReplayLog()

    def on_flow(flow: ReceivedFlow) -> None:
        log.arrived_s[flow.stamp_ns] = flow.arrived_s
        writer.write_raw(FLOW_TOPIC, CLOUD_TYPE, flow.stamp_ns, flow.raw)

    def on_diagnostics(raw: bytes) -> None:
        # As if received when the newest sweep was measured: viewers then show both together.
        if log.published_s:
            newest_ns = max(log.published_s)
            writer.write_raw(
                DIAGNOSTICS_TOPIC, "diagnostic_msgs/msg/DiagnosticArray", newest_ns, raw
            )

    with ReplayLink(POINTS_TOPIC, FLOW_TOPIC, on_flow, on_diagnostics) as link:
        _wait_for_node(link, node)
        for raw in _paced(reader, topic, link):
            node.check()
            published_s = time.monotonic()
            log.published_s[link.publish(raw)] = published_s
            progress(len(log.published_s), len(log.arrived_s))
        _wait_for_last_flow(link, node)
        progress(len(log.published_s), len(log.arrived_s))
        log.node_values = link.flow_values
    return log


def _wait_for_node(link: ReplayLink, node: NodeProcess) -> None:
    deadline_s = time.monotonic() + _START_TIMEOUT_S
    while not link.is_connected:
        node.check()
        if time.monotonic() > deadline_s:
            raise node.failure(f"the node was not there after {_START_TIMEOUT_S:.0f} s")
        link.spin_for(0.1)


def _paced(reader: BagReader, topic: str, link: ReplayLink) -> Iterator[bytes]:
    """The serialized messages, each at its time."""
    start_s, first_ns = time.monotonic(), 0
    for received_ns, raw in reader.raw_messages(topic):
        first_ns = first_ns or received_ns
        link.spin_for(start_s + (received_ns - first_ns) / _NANOSECONDS - time.monotonic())
        yield raw


def _wait_for_last_flow(link: ReplayLink, node: NodeProcess) -> None:
    """Waits until the node says that it has nothing left to do."""
    deadline_s = time.monotonic() + _LAST_FLOW_TIMEOUT_S
    link.spin_for(2.0)  # for a status from after the last sweep
    while link.flow_values.get("busy") != "False" and time.monotonic() < deadline_s:
        node.check()
        link.spin_for(0.5)
