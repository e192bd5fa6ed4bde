"""A topic on which nothing comes is said in the log, with those that there are."""

from __future__ import annotations

import time

import pytest
import rclpy
from rclpy.context import Context
from scene_flow_process import QUICK
from sensor_msgs.msg import PointCloud2
from waiting import PATIENCE_S

from mnsf_ros.node.diagnostics import InputState
from mnsf_ros.node.node_log import PERIOD_S, SilenceLog


class Story:
    """What happens to a node, and what it logs about it."""

    def __init__(self, *topics):
        self.lines, self.now_s, self._arrivals_s = [], 100.0, []
        self._log = SilenceLog(self, lambda: topics, clock=lambda: self.now_s)

    def warning(self, text):
        self.lines.append(f"warning: {text}")

    def info(self, text):
        self.lines.append(f"info: {text}")

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
    process = start_node(QUICK, "-r", "~/points:=/nothing")
    give_up_s = time.monotonic() + PATIENCE_S
    while "no sweep on /nothing for" not in process.log and time.monotonic() < give_up_s:
        time.sleep(0.1)
    assert "topics that are published: /lidar/points (at most" in process.log
    assert process.stop() == 0
