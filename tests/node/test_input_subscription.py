# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The subscription follows its publishers, and counts the clouds that it has missed."""

import time

import pytest
import rclpy
from moving_boxes import surfaces
from node_harness import SceneFlowPeer, Spinner
from rclpy.context import Context
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan, PointCloud2
from synthetic_clouds import xyz_message

from mnsf_ros.errors import SettingsError
from mnsf_ros.node import subscriptions
from mnsf_ros.node.raw_topics import RawTopics, cloud_topics, only_cloud_topic, other_types
from mnsf_ros.node.subscriptions import InputSubscription, MissedClouds
from mnsf_ros.recording.bag_topics import CLOUD_TYPE


@pytest.mark.parametrize(
    ("first", "second"), [(True, False), (False, True)], ids=["to best effort", "to reliable"]
)
def test_it_follows_a_publisher_that_comes_back(peer, drive, first, second):
    # A warning of an incompatible subscription would be gone a moment later.
    before = peer.process.log.count("incompatible QoS")
    gone = {"publishers": "0", "reliability": "best_effort"}.items()
    for reliable in (first, second):
        peer.stop_advertising()
        peer.spin_until(lambda: gone <= peer.values("input").items(), "the publisher to be gone")
        peer.advertise(reliable=reliable)
        peer.wait_for_node("reliable" if reliable else "best_effort")
    peer.flow_amid(drive.sweeps(0, 1, 2))
    assert peer.process.log.count("incompatible QoS") == before


def test_among_publishers_of_both_kinds_all_are_heard(peer, drive):
    peer.advertise(reliable=True)
    peer.wait_for_node()
    other = SceneFlowPeer(peer.process, "/quick", reliable=False, watches=False)
    expected = {"publishers": "2", "reliability": "best_effort"}
    peer.spin_until(lambda: expected.items() <= peer.values("input").items(), f"{expected}")
    sweeps = drive.sweeps(0, 1, 2)
    other.spin_until(lambda: other.diagnostics, "diagnostics")
    for sender, sweep in zip((peer, other, peer), sweeps, strict=True):
        sender.wait_for_subscription("best_effort")
        sender.send(sweep)
        peer.wait_for_diagnostics()
    peer.flow_of(sweeps[1])
    other.close()
    peer.wait_for_node()


def test_clouds_that_a_busy_node_overwrites_are_counted(ros):
    busy = Spinner("busy")
    reliable = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
    publisher = busy.node.create_publisher(PointCloud2, "~/points", reliable)
    received, missed = [], []
    subscription = InputSubscription(
        busy.node,
        "~/points",
        "reliable",
        received.append,
        lambda event, _text, how_many: missed.append((event, how_many)),
    )

    def publish(index):
        publisher.publish(xyz_message(surfaces(index, 12), stamp_ns=10**9 + index * 10**8))

    busy.spin_until(
        lambda: publisher.get_subscription_count() == subscription.num_publishers == 1, "both ends"
    )
    publish(0)
    busy.spin_until(lambda: len(received) == 1, "the first")
    for index in range(1, 41):
        publish(index)
    busy.spin_until(lambda: received[-1].header.stamp.sec == 5, "the last")
    busy.close()
    assert {event for event, _ in missed} == {"clouds_missed"}
    num_missed = sum(how_many for _, how_many in missed)
    assert num_missed >= 20
    assert len(received) + num_missed == 41


@pytest.mark.parametrize(
    ("numbers", "publishers", "missed"),
    [
        ([7, 8, 9, 17, 18], 1, [0, 0, 0, 7, 0]),
        ([500, 1, 2], 1, [0, 0, 0]),  # a publisher that starts anew begins at 1
        ([500, 32, 33], 1, [0, 31, 0]),
        ([1, 4, 7], 2, [0, 0, 0]),
        ([None, None, 3], 1, [0, 0, 0]),
    ],
)
def test_missed_clouds_by_their_numbers(numbers, publishers, missed):
    counter = MissedClouds()
    assert [counter.before(number, publishers) for number in numbers] == missed


def test_the_first_clouds_of_a_publisher_that_has_just_appeared_are_missed():
    counter = MissedClouds()
    counter.expect_a_new_publisher()
    assert [counter.before(number, 1) for number in (32, 33, 35)] == [31, 0, 1]


def test_clouds_before_a_publisher_was_found_are_counted(ros, monkeypatch):
    monkeypatch.setattr(subscriptions, "_DISCOVERY_S", 0.0)
    listener = Spinner("listener")
    received, missed = [], []
    subscription = InputSubscription(
        listener.node,
        "~/points",
        "reliable",
        received.append,
        lambda _event, _text, how_many: missed.append(how_many),
    )
    assert subscription.num_publishers == 0
    subscription.refresh()
    with RawTopics("lidar_of_another_process") as lidar:
        publisher = lidar.publisher(subscription.topic, CLOUD_TYPE)
        # Usually the listener does not know of the publisher yet, and hears none of these.
        for _ in range(5):
            publisher.publish(xyz_message(surfaces(0, 12), stamp_ns=10**9))
        # Each must know of the other: what is published between is heard by nobody, for ever.
        listener.spin_until(
            lambda: publisher.get_subscription_count() == subscription.num_publishers == 1, "both"
        )
        publisher.publish(xyz_message(surfaces(1, 12), stamp_ns=2 * 10**9))
        listener.spin_until(lambda: received and received[-1].header.stamp.sec == 2, "the last")
    listener.close()
    assert len(received) + sum(missed) == 6


class TestOnlyCloudTopic:
    """The lidar's topic is found where there is only one."""

    @pytest.fixture
    def lidars(self, ros, own_domain):
        """A node in a graph of its own; one process sees its topics at once."""
        context = Context()
        rclpy.init(args=[], context=context)
        node = rclpy.create_node("lidars", context=context)
        yield node
        node.destroy_node()
        context.try_shutdown()

    def found(self, search_s):
        try:
            return only_cloud_topic(search_s)
        except SettingsError as error:
            return str(error)

    @pytest.mark.parametrize(
        ("topics", "answer"),
        [
            (["/lidar/points", "/scene_flow/flow", "/scene_flow/objects"], "/lidar/points"),
            (["/rear/points", "/front/points"], "several PointCloud2 topics: /front/points, /rear"),
            (["/scene_flow/flow/moving"], "no PointCloud2 topic is published"),
        ],
    )
    def test_is_the_answer_or_named_in_it(self, lidars, topics, answer):
        for topic in topics:
            lidars.create_publisher(PointCloud2, topic, 1)
        # As long as this machine needs.
        assert any(self.found(search_s).startswith(answer) for search_s in (0.3, 2.0, 8.0, 32.0))

    def test_is_none_of_another_type_even_if_somebody_waits_there_for_clouds(self, lidars):
        lidars.create_publisher(PointCloud2, "/points", 1)
        lidars.create_subscription(PointCloud2, "/scan", print, 1)
        topics = ["/scan", "/points", "/nothing"]
        assert other_types(lidars, topics) == []
        # One process has one type for a topic; the scanner is another one's.
        with RawTopics("scanner") as scanner:
            scanner.node.create_publisher(LaserScan, "/scan", 1)
            give_up_s = time.monotonic() + 60
            while not lidars.count_publishers("/scan") and time.monotonic() < give_up_s:
                scanner.spin_for(0.1)
            assert other_types(lidars, topics) == ["/scan is a sensor_msgs/msg/LaserScan"]
            assert cloud_topics(lidars) == ["/points"]
