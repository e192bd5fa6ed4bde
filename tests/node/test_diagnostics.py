# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Levels, messages and values on /diagnostics, for what may happen to a node."""

from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from synthetic_clouds import over_ground

from mnsf_ros.core.flow_estimate import FlowEstimate, OptimizationResult, Start, StopReason
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.node import diagnostics
from mnsf_ros.node.diagnostics import Diagnostics, InputState
from mnsf_ros.settings import Settings
from mnsf_ros.stream import pipeline as stream_pipeline
from mnsf_ros.stream.pipeline import StreamStatistics

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
PATIENCE_S = 2.0
SILENCE = "no sweep on /points: no clouds are published"


class Story:
    """Events of a node, at times of its own, and its diagnostics after them."""

    def __init__(self):
        self.now_s = 100.0
        self.cause, self.warnings = "no clouds are published", {}

    def begin(self):
        self.statistics = StreamStatistics()
        self._diagnostics = Diagnostics("robot/flow_node", self, lambda: self.cause)

    def warn(self, kind, text):
        """A warning in the log."""
        self.warnings.setdefault(kind, text)

    def receive(self, *events):
        self.count("sweeps_received", *events)

    def count(self, *events):
        for event in events:
            self.statistics.count(event)

    def fail(self, times=1):
        for _ in range(times):
            self.statistics.add_failure("too few points")

    def estimate(self, latency_ms=50.0, start=Start.WARM, ego_source=None, lost=""):
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
            own_body=np.linspace((-2.06, 0, 0), (-1.53, 0, 0), 130, dtype=np.float32),
            over_ground=None if ego_source is None else over_ground(source=ego_source, lost=lost),
        )
        self.statistics.add_estimate(latency_ms, estimate)

    def statuses(self, load=0, wanted="registration", pause="", findings=None, **changes):
        changes |= {"node.stale_after_s": PATIENCE_S, "ego_motion.source": wanted}
        state = InputState("/points", "reliable", 1, pause=pause)
        settings = Settings().changed(changes)
        now = self.statistics.snapshot()
        return self._diagnostics.statuses(now, state, load, settings, findings)

    def says(self, **options):
        """(level, message) of `input` and of `flow`."""
        return [(status.level, status.message) for status in self.statuses(**options)[:2]]

    def goes_on(self, duration_s, *events):
        """(level, message) of `flow` in a time in which these events happen twice a second."""
        said = []
        for _ in range(round(2 * duration_s)):
            self.now_s += 0.5
            self.count(*events)
            said.append(self.says()[1])
        return said


@pytest.fixture
def story(monkeypatch):
    story = Story()
    clock = SimpleNamespace(monotonic=lambda: story.now_s)
    for module in (diagnostics, stream_pipeline):
        monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(diagnostics.os, "getloadavg", lambda: (4.26, 1.0, 1.0))
    monkeypatch.setattr(diagnostics.os, "cpu_count", lambda: 2)
    story.begin()
    return story


def values_of(status):
    return {item.key: item.value for item in status.values}


class TestLevels:
    def test_of_a_stream_that_begins_goes_on_and_stops(self, story):
        assert story.says() == [(STALE, SILENCE), (OK, "waiting for sweeps")]
        story.receive()
        assert story.says() == [(OK, "receiving"), (OK, "waiting for the third sweep")]
        assert story.says(load=1)[1] == (OK, "estimating")
        story.estimate()
        assert story.says() == [(OK, "receiving"), (OK, "estimating")]
        story.now_s += PATIENCE_S + 0.1
        assert story.says() == [
            (STALE, SILENCE),
            (OK, "waiting for sweeps"),
        ]
        story.receive()
        assert story.says()[0] == (OK, "receiving")

    @pytest.mark.parametrize(
        ("event", "message"),
        [
            ("clouds_undecodable", "clouds that cannot be decoded"),
            ("clouds_empty", "clouds without a measured point"),
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

    def test_when_nobody_subscribes(self, story):
        story.receive("triplets_unwatched")
        assert story.says()[1] == (OK, "resting: nobody subscribes to the flow")

    def test_of_dropped_triplets_count_those_of_the_last_ten_seconds(self, story):
        story.goes_on(60, "sweeps_received", "flows_out")
        story.estimate()
        said = story.goes_on(10, "sweeps_received", "triplets_dropped")
        assert said[2] == (
            WARN,
            "CPU busy: 18 of 21 flows (load 4.3, cores 2). "
            "Close other programs, or lower crop.max_range_m.",
        )
        assert story.says()[1][0] != WARN  # told once

    @pytest.mark.parametrize(
        ("events", "words"),
        [
            (("sweeps_received", "sweeps_frame_changed"), "frame_id changes"),
            (("sweeps_received", "sweeps_duplicate"), "the same stamp"),
            (("sweeps_received", "sweeps_out_of_order"), "go backwards"),
            (("sweeps_received", "sweeps_time_went_back"), "jump back"),
            (("sweeps_received", "sweeps_gap"), "buffer.max_interval_s"),
            (("clouds_undecodable",), "cannot be decoded"),
            (("clouds_empty",), "no measured point"),
            (("sweeps_received", "estimates_failed"), "every estimate fails"),
            (("sweeps_received", "triplets_dropped"), "takes too long"),
        ],
    )
    def test_of_clouds_without_flow_name_the_counter(self, story, events, words):
        story.says()
        *before, (level, message) = story.goes_on(PATIENCE_S + 0.5, *events)
        assert all(level != ERROR for level, _ in before)
        assert level == ERROR
        assert words in message
        assert message.endswith(f"(see {events[-1]})")

    def test_of_clouds_without_flow_name_the_most_frequent_reason_since_the_last(self, story):
        story.goes_on(60, "sweeps_received", "sweeps_gap", "flows_out")
        story.goes_on(1, "sweeps_received", "sweeps_gap")
        said = story.goes_on(10, "sweeps_received", "sweeps_duplicate")
        assert "sweeps_duplicate" in said[-1][1]

    def test_of_the_flow_of_a_lidar_that_is_silent_and_comes_back(self, story):
        story.goes_on(1, "sweeps_received", "flows_out")
        for duration_s, *events in ((60,), (1, "sweeps_received"), (9, "flows_out")):
            assert {level for level, _ in story.goes_on(duration_s, *events)} == {OK}

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
        story.estimate(latency_ms=3000.0)
        assert story.says()[1] == (WARN, "latency above 500 ms (node.max_latency_ms)")
        assert story.says(**{"node.max_latency_ms": 0})[1] == (OK, "estimating")
        # Of flows that nobody wants any more.
        story.count("triplets_unwatched")
        assert story.says()[1] == (OK, "resting: nobody subscribes to the flow")

    def test_of_silence_have_its_cause_and_log_each_once(self, story):
        story.receive()
        # Nobody listens in a pause.
        story.now_s += 3.0
        story.says(pause="disabled")
        assert not story.warnings
        for cause in (story.cause, "/points is a sensor_msgs/msg/LaserScan", story.cause):
            story.now_s += 3.0
            story.cause = cause
            assert story.says()[0] == (STALE, f"no sweep on /points: {cause}")
        assert list(story.warnings.values()) == [
            f"{SILENCE} (3 s of silence)",
            "no sweep on /points: /points is a sensor_msgs/msg/LaserScan (6 s of silence)",
        ]

    def test_of_silence_before_the_first_sweep_are_logged_after_ten_seconds(self, story):
        for _ in range(10):
            assert story.says()[0] == (STALE, SILENCE)
            story.now_s += 1.0
            assert not story.warnings
        story.now_s += 0.1
        story.says()
        assert list(story.warnings.values()) == [f"{SILENCE} (10 s of silence)"]

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


def test_lost_ego_motion_is_an_error_while_it_lasts_and_then_a_warning(story):
    def goes_on(number, lost=""):
        for _ in range(number):
            story.now_s += 0.1
            story.estimate(ego_source="lost" if lost else "registration", lost=lost)
        status = story.statuses()[2]
        return status.level, status.message

    assert goes_on(20) == (OK, "registration")
    text = "lost: clouds repeat; nothing counts as moving until it is found again"
    assert goes_on(3, "clouds repeat") == (ERROR, text)
    values = values_of(story.statuses()[2])
    assert {"lost": "clouds repeat", "sweeps lost, recent": "3"}.items() <= values.items()
    assert values["lost for [s]"] == "0.2"
    assert story.warnings == {"ego motion clouds repeat": f"ego motion is {text}"}
    again = "found again: it was lost in {} of the last {} sweeps"
    assert goes_on(5) == (WARN, again.format(3, 10))
    assert values_of(story.statuses()[2])["lost for [s]"] == "0.0"
    assert goes_on(3) == (WARN, again.format(2, 10))
    assert goes_on(10) == (OK, "registration")
    # Also one that nobody heard of meanwhile.
    goes_on(1, "clouds repeat")
    assert goes_on(30)[0] == OK
    story.estimate(ego_source="lost", lost="clouds repeat")
    assert goes_on(30) == (WARN, again.format(1, 31))
    # Nobody knows it while nobody subscribes.
    assert goes_on(1, "clouds repeat")[0] == ERROR
    story.receive("triplets_unwatched")
    assert goes_on(0) == (OK, "not estimated")


def test_findings_are_said_by_the_worst_of_them(story):
    def says(*findings):
        status = story.statuses(findings=findings)[3]
        return status.level, status.message

    note = Finding("each point has its time", Severity.INFO, "points have no times", "Name them")
    body = Finding("no own body", Severity.WARNING, "130 points within 2.1 m", "Leave them out")
    turned = Finding("z is up", Severity.ERROR, "z points down", "Turn the frame")
    assert story.statuses()[3].message == "waiting for more sweeps"
    assert says() == (OK, "nothing wrong was found")
    assert says(note) == (OK, "nothing wrong was found")
    assert says(body, note) == (WARN, "130 points within 2.1 m. Leave them out")
    assert says(turned, body) == (ERROR, "z points down. Turn the frame (and 1 more)")
    assert story.warnings == {
        "no own body": "130 points within 2.1 m. Leave them out",
        "z is up": "z points down. Turn the frame",
    }
    values = values_of(story.statuses(findings=[body, note])[3])
    assert values["each point has its time"] == "points have no times. Name them"


class TestValues:
    def test_before_the_first_sweep(self, story):
        statuses = story.statuses()
        assert [status.name for status in statuses] == [
            f"robot/flow_node: {part}" for part in ("input", "flow", "ego motion", "input check")
        ]
        assert {status.hardware_id for status in statuses} == {"/points"}
        of_input, of_flow, of_ego_motion, of_input_check = map(values_of, statuses)
        assert of_input == {
            "topic": "/points",
            "publishers": "1",
            "reliability": "reliable",
            "rate [Hz]": "0.00",
            "time of each point": "unknown",
            "clouds of a revolution": "1",
            "mounting": "unknown",
            "imu": "none",
        }
        assert (of_flow["latency p95 [ms]"], of_flow["queue"]) == ("unknown", "0")
        assert (of_flow["method"], of_flow["last failure"]) == ("online", "none")
        assert of_ego_motion == {
            "source": "none",
            "wanted": "registration",
            "lost": "no",
            "lost for [s]": "0.0",
            "sweeps lost, recent": "0",
        }
        assert of_input_check == {}

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
            "own body": "130 points within 2.1 m",
            "own body boxes": "-2.1 0 0 -1.5 0 0",
            "cold starts, recent": "1",
            "effort": "full",
            "estimate median [ms]": "3.5",
            "prepare median [ms]": "1.0",
            "forward median [ms]": "2.5",
            "forward stop reason": "iteration_limit",
        }
        assert expected.items() <= values.items()

    def test_rates_are_of_ten_seconds_and_fall_in_silence(self, story):
        for _ in range(300):
            story.now_s += 0.1
            story.receive()
            story.statuses()
        rates = []
        for _ in range(2):
            rates.append(values_of(story.statuses()[0])["rate [Hz]"])
            story.now_s += 10.0
        assert rates == ["10.00", "0.00"]

    def test_only_recent_estimates_count(self, story):
        for number in range(350):
            story.estimate(latency_ms=float(number))
        assert values_of(story.statuses()[1])["latency median [ms]"] == "299.5"


class TestOnTheTopic:
    def test_of_a_node_without_input(self, peer, drive):
        peer.flow_amid(drive.sweeps(0, 1, 2))
        values = peer.values("input") | peer.values("flow") | peer.values("ego motion")
        assert [name for name, value in values.items() if not value] == []
        assert peer.set({"node.stale_after_s": 0.2})[0].successful
        peer.spin_until(lambda: peer.status("input").level == STALE, "silence to be noticed")
        topic = peer.points_topic
        cause = f"no sweep on {topic}: {topic} is published, but nothing arrives"
        peer.spin_until(lambda: cause in peer.status("input").message, "its cause")
        peer.spin_until(
            lambda: peer.status("flow").message == "waiting for sweeps", "the flow to know it, too"
        )
        assert peer.set({"node.stale_after_s": 60.0})[0].successful
        peer.spin_until(lambda: peer.status("input").level == OK, "more patience")
        assert f"[quick]: {cause}" in peer.process.log
