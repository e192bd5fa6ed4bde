# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The end of a replay: every sweep is accounted for, however late the node says so."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Header

from mnsf_ros.demo import replay as replay_module
from mnsf_ros.demo.demo_run import verdict
from mnsf_ros.demo.replay import ReplayLink, ReplayLog, replay
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from msg_utils.cdr import serialized_cloud
from msg_utils.point_cloud2 import encoding_of_columns

NUM_SWEEPS = 6


def test_a_node_is_there_when_it_sees_us_too(own_domain):
    """Seen from here alone it would be too early: it works only for whom it sees."""
    with (
        RawTopics("node_of_the_test") as node,
        ReplayLink("/points", "/flow") as link,
    ):
        node.subscribe("/points", CLOUD_TYPE, lambda _: None)
        flow = node.publisher("/flow", CLOUD_TYPE)
        diagnostics = node.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        give_up_s = time.monotonic() + 300
        while not (link.is_heard and link.num_publishers("/flow")):
            assert time.monotonic() < give_up_s
            link.spin_for(0.02)
        assert not link.is_connected
        while not link.is_connected:
            assert time.monotonic() < give_up_s
            diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name="scene_flow: flow")]))
            link.spin_for(0.02)
        link.publish(cloud(stamp_s=8))
        # Flows of other sweeps do not count.
        for stamp_s in (7, 8):
            flow.publish(cloud(stamp_s))
        while not link.log.arrived_s:
            assert time.monotonic() < give_up_s
            link.spin_for(0.02)
        assert [*link.log.arrived_s] == [8_000_000_000]


def cloud(stamp_s):
    """A serialized cloud of one point."""
    header = Header(frame_id="lidar")
    header.stamp.sec = stamp_s
    columns = {axis: np.zeros(1, np.float32) for axis in "xyz"}
    return serialized_cloud(header, encoding_of_columns(columns, 1, 1), is_dense=True)


class LateLink(ReplayLink):
    """A node on a loaded machine: its status is stale, its last flow late; time is counted."""

    clock_s, is_connected = 0.0, True

    def __init__(self, events):
        self.events, self.num_statuses = dict(events), 0
        self.log = ReplayLog(values={"busy": "False"})

    def __exit__(self, *_):
        pass

    def publish(self, raw):
        self.log.published_s[raw] = self.clock_s

    def subscribe(self, *_):
        pass

    def spin_for(self, duration_s):
        self.clock_s += max(duration_s, 0.0)
        if len(self.log.published_s) < NUM_SWEEPS:
            return
        for due_s in [due_s for due_s in self.events if due_s <= self.clock_s]:
            self._happens(self.events.pop(due_s))

    def _happens(self, event):
        if isinstance(event, int):
            self.log.arrived_s[event] = self.clock_s
        else:
            self.log.counts, self.num_statuses = event, self.num_statuses + 1


def counts(received, formed, out, dropped=0):
    names = ("sweeps_received", "triplets_formed", "flows_out", "triplets_dropped")
    return dict(zip(names, (received, formed, out, dropped), strict=True))


def replayed(monkeypatch, events):
    """The log of a replay; `events`: seconds to what happens, a flow's stamp or counts."""
    links = []

    def link(*_):
        links.append(LateLink(events))
        return links[0]

    monkeypatch.setattr(replay_module, "ReplayLink", link)
    clock = SimpleNamespace(monotonic=lambda: links[0].clock_s if links else 0.0)
    monkeypatch.setattr(replay_module, "time", clock)
    stamps = [100_000_000 * number for number in range(1, NUM_SWEEPS + 1)]
    reader = SimpleNamespace(raw_messages=lambda topic: zip(stamps, stamps, strict=True))
    writer = SimpleNamespace(write_raw=lambda *_: None)
    node = SimpleNamespace(check=lambda: None)
    return replay(reader, "/points", node, writer, lambda *_: None)


STALE, LOST = counts(4, 2, 2), counts(5, 3, 2, dropped=1)
# Events of a node, and what the replay shows of sweeps, flows and drops.
ENDS = {
    "stale diagnostics do not end it": (
        {0.6: 200_000_000, 0.7: 300_000_000, 1.0: STALE, 2.2: STALE, 4.0: 500_000_000}
        | {4.5: counts(6, 4, 3, dropped=1)},
        (6, 3, 1),
    ),
    "a published flow is waited for": (
        {0.6: 200_000_000, 1.0: counts(6, 4, 2, dropped=2), 3.9: 500_000_000},
        (6, 2, 2),
    ),
    "without drops": (
        {0.6 + number / 100: 100_000_000 * (number + 2) for number in range(4)}
        | {1.0: counts(6, 4, 4)},
        (6, 4, 0),
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_every_sweep_is_accounted_for(monkeypatch, name):
    events, expected = ENDS[name]
    log = replayed(monkeypatch, events)
    assert (len(log.published_s), len(log.arrived_s), log.num_dropped) == expected
    assert log.losses["flows lost in transport"] == 0
    assert log.is_complete


def test_what_never_comes_is_told_and_not_waited_for_long(monkeypatch):
    events = {0.6: 200_000_000} | {1.0 + number: dict(LOST) for number in range(60)}
    log = replayed(monkeypatch, events)
    assert log.losses["flows lost in transport"] == log.losses["sweeps lost in transport"] == 1
    assert not log.is_complete


def finished(num_flows, counts):
    """A log of 60 sweeps, whose flows came 88 ms after the next sweep."""
    stamps = [100_000_000 * number for number in range(60)]
    published_s = {stamp: stamp / 1e9 for stamp in stamps}
    arrived_s = {stamp: stamp / 1e9 + 0.188 for stamp in stamps[1 : 1 + num_flows]}
    return ReplayLog(published_s, arrived_s, counts, {"estimate median [ms]": "170.0"})


def test_the_verdict_is_one_line():
    received = {"sweeps_received": 60}
    assert verdict(finished(57, received)) == "57 of 58 flows, p95 88 ms: keeps up"
    assert verdict(finished(18, received | {"triplets_dropped": 40, "flows_out": 18})).startswith(
        "CPU busy: 18 of 58 flows (an estimate takes 170 ms, sweeps come every 100 ms, load "
    )
    failed = received | {"estimates_failed": 20, "flows_out": 38}
    assert verdict(finished(38, failed)) == "38 of 58 flows, p95 88 ms: 20 failed estimates"
