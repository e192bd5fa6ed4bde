# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Faults that go on are logged at once, then at a low rate with their count; so is silence."""

from __future__ import annotations

import re
import time

import pytest
import rclpy
from rclpy.context import Context
from scene_flow_process import QUICK
from sensor_msgs.msg import PointCloud2
from waiting import PATIENCE_S

from mnsf_ros.node.diagnostics import InputState
from mnsf_ros.node.node_log import PERIOD_S, FaultLog, SilenceLog


class Lines:
    """A logger that remembers."""

    def __init__(self):
        self.lines = []

    def info(self, text):
        self.lines.append(f"info: {text}")

    def warning(self, text):
        self.lines.append(f"warning: {text}")

    def error(self, text):
        self.lines.append(f"error: {text}")


def test_a_fault_of_an_hour_is_logged_again_with_its_count():
    logger, now_s = Lines(), [0.0]
    faults = FaultLog(logger, clock=lambda: now_s[0])
    for number in range(36_001):
        now_s[0] = number * 0.1
        faults.warn("undecodable", "a cloud cannot be decoded")
    assert len(logger.lines) == 1 + 3600 / PERIOD_S
    assert all(line.startswith("warning: a cloud cannot be decoded (") for line in logger.lines)
    counts = [re.search(r"\(([\d,]+) times since \d{4}-", line) for line in logger.lines[1:]]
    assert counts[0].group(1) == "6,001"
    assert counts[-1].group(1) == "36,001"


def test_kinds_are_counted_by_themselves():
    logger, now_s = Lines(), [0.0]
    faults = FaultLog(logger, clock=lambda: now_s[0])
    faults.warn("empty", "no point")
    faults.error("lost", "lost")
    assert [line.split(" (")[0] for line in logger.lines] == ["warning: no point", "error: lost"]
    now_s[0] = PERIOD_S
    faults.error("lost", "lost")
    assert logger.lines[2].startswith("error: lost (2 times since")


def test_a_fault_that_is_over_is_not_logged():
    logger, now_s = Lines(), [0.0]
    faults = FaultLog(logger, clock=lambda: now_s[0])
    faults.warn("empty", "no point")
    now_s[0] = 10 * PERIOD_S
    assert len(logger.lines) == 1


class Story(Lines):
    """What happens to a node, and what it logs about it."""

    def __init__(self, *topics):
        super().__init__()
        self.now_s, self._arrivals_s, self.topics = 100.0, [], topics
        self._log = SilenceLog(self, lambda: self.topics, clock=lambda: self.now_s)

    def go_on(self, seconds, *, with_sweeps=False, pause=""):
        for _ in range(round(seconds)):
            self.now_s += 1.0
            if with_sweeps:
                self._arrivals_s.append(self.now_s)
            self._log.look(self._arrivals_s, InputState("/points", "reliable", 1, pause=pause), 2.0)


WARNING = (
    "warning: no sweep on /points for 3 s; PointCloud2 topics that are published: /front, /rear "
    "(at most every 10 min)"
)


def test_a_topic_without_sweeps_is_one_warning_with_the_topics_that_there_are():
    story = Story("/front", "/rear")
    story.go_on(2)
    assert story.lines == []
    story.go_on(PERIOD_S)
    assert story.lines == [WARNING]
    story.go_on(2)
    assert len(story.lines) == 2
    story.go_on(60, with_sweeps=True)
    assert story.lines[2:] == ["info: sweeps come on /points"]


def test_without_any_topic_it_says_so():
    story = Story()
    story.go_on(3)
    assert "; no PointCloud2 topic is published, see ROS_DOMAIN_ID" in story.lines[0]


def test_a_topic_that_appears_later_is_named_at_once():
    story = Story()
    story.go_on(10)
    story.topics = ("/front",)
    story.go_on(10)
    story.topics = ("/front", "/rear")
    story.go_on(10)
    story.topics = ("/rear",)
    story.go_on(10)
    assert [line.split("; ")[1].split(" (")[0] for line in story.lines] == [
        "no PointCloud2 topic is published, see ROS_DOMAIN_ID if one should be",
        "PointCloud2 topics that are published: /front",
        "PointCloud2 topics that are published: /front, /rear",
    ]


def test_topics_that_come_and_go_do_not_fill_the_log():
    story = Story()
    for number in range(500):
        story.topics = (f"/cloud_{number}",)
        story.go_on(1)
    assert len(story.lines) == 20


def test_a_lidar_that_comes_and_goes_does_not_fill_the_log():
    story = Story("/points")
    for _ in range(50):
        story.go_on(5, with_sweeps=True)
        story.go_on(5)
    assert [line.split(":")[0] for line in story.lines] == ["info", "warning", "info"]


def test_a_pause_is_no_silence():
    story = Story("/points")
    story.go_on(60, pause="disabled")
    story.go_on(2)
    story.go_on(60, with_sweeps=True)
    story.go_on(60, pause="disabled")
    story.go_on(2)
    assert story.lines == ["info: sweeps come on /points"]


@pytest.fixture
def lidar(ros, other_domain):
    """A publisher of clouds, seen by nodes that start now."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("lidar", context=context)
    yield node.create_publisher(PointCloud2, "/lidar/points", 1)
    node.destroy_node()
    context.try_shutdown()


def test_the_node_names_the_topic_of_the_lidar(lidar, start_node):
    process = start_node(QUICK | {"node.stale_after_s": 2.0}, "-r", "~/points:=/nothing")
    give_up_s = time.monotonic() + PATIENCE_S
    named = "topics that are published: /lidar/points (at most"
    while named not in process.log and time.monotonic() < give_up_s:
        time.sleep(0.1)
    assert named in process.log
    assert process.stop() == 0
