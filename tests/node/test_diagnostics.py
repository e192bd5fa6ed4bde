# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Levels, messages and values on /diagnostics, for what may happen to a node."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from synthetic_clouds import over_ground

from mnsf_ros.core.flow_estimate import (
    FlowEstimate,
    OptimizationResult,
    Start,
    StopReason,
)
from mnsf_ros.node.diagnostics import Diagnostics, InputState
from mnsf_ros.online.online_statistics import OnlineStatistics
from mnsf_ros.settings import Settings

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)


class Story:
    """Events of a node, and its diagnostics after them."""

    def __init__(self):
        self.statistics, self.topics, self.warnings = OnlineStatistics(), [], {}
        self._diagnostics = Diagnostics("robot/flow_node", self, lambda: self.topics)

    def warn(self, kind, text):
        """A warning in the log."""
        self.warnings.setdefault(kind, text)

    def receive(self, *events):
        for event in ("sweeps_received", *events):
            self.statistics.count(event)
        self.statistics.add_arrival()

    def fail(self, times=1):
        for _ in range(times):
            self.statistics.add_failure("too few points")

    def estimate(self, latency_ms=50.0, start=Start.WARM, ego_source=None):
        self.statistics.count("flows_out")
        estimate = FlowEstimate(
            flow=np.zeros((1, 3), np.float32),
            kept=np.ones(1, bool),
            times_ms={"prepare": 1.0, "forward": 2.5},
            fits={"forward": OptimizationResult(0.1, 40, StopReason.ITERATION_LIMIT)},
            start=start,
            device="cpu",
            distance_kind="tree",
            precision="float32",
            over_ground=None if ego_source is None else over_ground(source=ego_source),
        )
        self.statistics.add_estimate(latency_ms, estimate)

    def statuses(self, load=0, stale_after_s=60.0, wanted="registration", pause="", **changes):
        changes |= {"node.stale_after_s": max(stale_after_s, 0.1), "ego_motion.source": wanted}
        settings = Settings().changed(changes)
        # Less than a user may set, so that a test need not wait.
        node = replace(settings.node, stale_after_s=stale_after_s)
        state = InputState("/points", "reliable", 1, pause=pause)
        snapshot = self.statistics.snapshot()
        return self._diagnostics.statuses(snapshot, state, load, replace(settings, node=node))

    def says(self, **options):
        """(level, message) of `input` and of `flow`."""
        return [(status.level, status.message) for status in self.statuses(**options)[:2]]


@pytest.fixture
def story():
    return Story()


def values_of(status):
    return {item.key: item.value for item in status.values}


class TestLevels:
    def test_of_a_stream_that_begins_goes_on_and_stops(self, story):
        assert story.says() == [(STALE, "no sweep on /points"), (OK, "waiting for sweeps")]
        story.receive()
        assert story.says() == [(OK, "receiving"), (OK, "waiting for the third sweep")]
        assert story.says(load=1)[1] == (OK, "estimating")
        story.estimate()
        assert story.says() == [(OK, "receiving"), (OK, "estimating")]
        time.sleep(0.01)
        assert story.says(stale_after_s=0.005) == [
            (STALE, "no sweep on /points"),
            (OK, "waiting for sweeps"),
        ]
        story.receive()
        assert story.says()[0] == (OK, "receiving")

    @pytest.mark.parametrize(
        ("event", "message"),
        [
            ("clouds_undecodable", "clouds that cannot be decoded"),
            ("clouds_empty", "clouds without a finite point"),
            ("clouds_missed", "clouds are missed (see clouds_missed)"),
        ],
    )
    def test_of_faults_of_the_input_last_until_the_next_status(self, story, event, message):
        story.receive(event)
        assert story.says()[0] == (WARN, message)
        assert story.says()[0] == (OK, "receiving")

    @pytest.mark.parametrize(("num_received", "level"), [(1, ERROR), (8, WARN)])
    def test_of_clouds_that_are_lost_in_transport(self, story, num_received, level):
        for _ in range(num_received - 1):
            story.receive()
        story.receive("sweeps_lost_in_transport")
        lost = "clouds are lost in transport (see sweeps_lost_in_transport)"
        assert story.says()[0] == (level, lost)
        story.receive()
        assert story.says()[0] == (OK, "receiving")

    def test_when_triplets_are_dropped_or_not_wanted(self, story):
        story.receive("triplets_dropped")
        level, message = story.says(load=2)[1]
        assert level == WARN
        assert message.startswith("CPU busy: 0 of 1 flows")
        story.receive("triplets_unwatched")
        assert story.says()[1] == (OK, "resting: nobody subscribes to the flow")

    def test_of_sweeps_that_give_no_flow(self, story):
        for _ in range(2):
            story.receive("sweeps_frame_changed")
            level, message = story.says(stale_after_s=0.0)[1]
        assert level == ERROR
        assert message.endswith("(see sweeps_frame_changed)")

    def test_of_failed_estimates_which_one_bad_sweep_makes_three_of(self, story):
        story.receive()
        story.fail()
        status = story.statuses()[1]
        assert (status.level, status.message) == (WARN, "the last estimate failed")
        assert values_of(status)["last failure"] == "too few points"
        assert story.says(**{"node.max_failures": 0})[1][0] == ERROR
        story.fail(2)
        assert story.says()[1][0] == WARN
        story.fail()
        assert story.says()[1] == (
            ERROR,
            "4 estimates failed in a row (see estimates_failed and last failure)",
        )
        story.estimate()
        assert story.says()[1] == (OK, "estimating")

    def test_of_latency_have_a_limit(self, story):
        story.receive()
        story.estimate(latency_ms=120.0)
        assert story.says()[1] == (OK, "estimating")
        assert story.says(**{"node.max_latency_ms": 130.0})[1] == (OK, "estimating")
        text = "latency above 100 ms (node.max_latency_ms)"
        assert story.says(**{"node.max_latency_ms": 100})[1] == (WARN, text)

    def test_of_silence_are_logged_with_the_topics_that_are_published(self, story):
        assert story.says()[0] == (STALE, "no sweep on /points")
        # Nobody listens in a pause.
        time.sleep(0.01)
        story.says(stale_after_s=0.005, pause="disabled")
        assert not story.warnings
        for topics in ([], ["/front", "/rear"], []):
            time.sleep(0.01)
            story.topics = topics
            story.says(stale_after_s=0.005)
        assert list(story.warnings.values()) == [
            f"no sweep on /points for 0 s; {advice}"
            for advice in (
                "no PointCloud2 topic is published, see ROS_DOMAIN_ID if one should be",
                "PointCloud2 topics that are published: /front, /rear",
            )
        ]

    def test_while_the_node_is_disabled(self, story):
        story.receive("clouds_missed")
        story.fail()
        statuses = story.statuses(pause="disabled, see the service set_enabled")
        assert {(status.level, status.message) for status in statuses} == {
            (OK, "disabled, see the service set_enabled")
        }


def test_ego_motion_of_another_source_than_wanted_is_degraded(story):
    def says(wanted="odometry"):
        status = story.statuses(wanted=wanted)[2]
        return status.level, status.message

    assert says() == (OK, "not estimated")
    story.estimate()
    assert says() == (OK, "not estimated")
    for source in ("start", "odometry"):
        story.estimate(ego_source=source)
        assert says() == (OK, source)
    story.estimate(ego_source="registration")
    assert says() == (WARN, "degraded: no odometry, registration instead")
    assert says(wanted="registration") == (OK, "registration")
    values = values_of(story.statuses(wanted="odometry")[2])
    assert values["source"] == "registration"
    assert (values["odometry, recent"], values["registration, recent"]) == ("1", "1")


class TestValues:
    def test_before_the_first_sweep(self, story):
        statuses = story.statuses()
        assert [status.name for status in statuses] == [
            f"robot/flow_node: {part}" for part in ("input", "flow", "ego motion")
        ]
        assert {status.hardware_id for status in statuses} == {"/points"}
        of_input, of_flow, of_ego_motion = map(values_of, statuses)
        assert of_input == {
            "topic": "/points",
            "publishers": "1",
            "reliability": "reliable",
            "rate [Hz]": "0.00",
            "time of each point": "unknown",
        }
        assert (of_flow["latency p95 [ms]"], of_flow["queue"]) == ("unknown", "0")
        assert (of_flow["method"], of_flow["last failure"]) == ("online", "none")
        assert of_ego_motion == {"source": "none", "wanted": "registration"}

    def test_of_estimates(self, story):
        for latency_ms in (10.0, 20.0, 30.0):
            story.receive("triplets_formed")
            story.estimate(latency_ms, Start.COLD_GAP if latency_ms == 10.0 else Start.WARM)
        values = values_of(story.statuses(load=2)[1])
        expected = {
            "latency median [ms]": "20.0",
            "latency p95 [ms]": "29.0",
            "queue": "1",
            "busy": "True",
            "flows_out": "3",
            "triplets_formed": "3",
            "device": "cpu",
            "distance": "tree",
            "precision": "float32",
            "start": "warm",
            "cold starts, recent": "1",
            "estimate median [ms]": "3.5",
            "prepare median [ms]": "1.0",
            "forward median [ms]": "2.5",
            "forward iterations, last": "40",
            "forward stop reasons, recent": "iteration_limit 3",
        }
        assert expected.items() <= values.items()


class TestOnTheTopic:
    def test_of_a_node_without_input(self, peer, drive):
        peer.flow_amid(drive.sweeps(0, 1, 2))
        assert peer.set({"node.stale_after_s": 0.2})[0].successful
        peer.spin_until(lambda: peer.status("input").level == STALE, "silence to be noticed")
        assert peer.status("input").message == f"no sweep on {peer.points_topic}"
        peer.spin_until(
            lambda: peer.status("flow").message == "waiting for sweeps", "the flow to know it, too"
        )
        assert peer.set({"node.stale_after_s": 60.0})[0].successful
        peer.spin_until(lambda: peer.status("input").level == OK, "more patience")
        assert f"[quick]: no sweep on {peer.points_topic} for" in peer.process.log
