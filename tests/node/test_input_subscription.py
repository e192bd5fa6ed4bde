# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The subscription follows its publishers, and counts the clouds that it has missed."""

import array
import itertools
import time
import zlib

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from moving_boxes import surfaces
from node_harness import PATIENCE_S, QUICK, SceneFlowPeer, Spinner
from rclpy.context import Context
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan, PointCloud2
from synthetic_clouds import xyz_message

from mnsf_ros.node.cloud_topics import CloudSearch, cloud_topics, fault_of
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.node.subscriptions import InputSubscription, MissedClouds
from msg_utils.other_clouds import CLOUD_TYPE, COMPRESSED_TYPE


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
        ([500, 32, 35], 1, [0, 0, 2]),
        ([1, 4, 7], 2, [0, 0, 0]),
        ([None, None, 3], 1, [0, 0, 0]),
    ],
)
def test_missed_clouds_by_their_numbers(numbers, publishers, missed):
    counter = MissedClouds()
    assert [counter.before(number, publishers) for number in numbers] == missed


def test_clouds_before_the_first_of_a_publisher_are_not_missed(ros):
    listener = Spinner("listener")
    stamps_s, missed = [], []
    subscription = InputSubscription(
        listener.node,
        "~/points",
        "reliable",
        lambda cloud: stamps_s.append(cloud.header.stamp.sec),
        lambda _event, _text, how_many: missed.append(how_many),
    )

    for start_s in (1, 10):  # of two lidars, the second of which replaces the first
        listener.spin_until(lambda: subscription.num_publishers == 0, "nobody")
        subscription.refresh()
        with RawTopics("lidar_of_another_process") as lidar:
            publisher = lidar.publisher(subscription.topic, CLOUD_TYPE)
            # Usually the listener does not know of the publisher yet, and hears none of these.
            for _ in range(5):
                publisher.publish(xyz_message(surfaces(0, 12), stamp_ns=start_s * 10**9))
            # Each must know of the other: what is published between is heard by nobody, for ever.
            listener.spin_until(
                lambda publisher=publisher: (
                    publisher.get_subscription_count() == subscription.num_publishers == 1
                ),
                "both",
            )
            last_s = start_s + 1
            publisher.publish(xyz_message(surfaces(1, 12), stamp_ns=last_s * 10**9))
            listener.spin_until(
                lambda last_s=last_s: stamps_s and stamps_s[-1] == last_s, "the last"
            )
    listener.close()
    assert not missed


class TestOfTheGraph:
    """Topics of clouds, and why none come; the lidars are nodes of other contexts."""

    @pytest.fixture
    def advertise(self, ros, own_domain):
        """Adds a node with publishers: topic to class, or to class and reliability."""
        ends = []

        def advertise(name, **topics):
            context = Context()
            rclpy.init(args=[], context=context)
            node = rclpy.create_node(name, context=context)
            for topic, kind in topics.items():
                node.create_publisher(kind, f"/{topic.replace('__', '/')}", 1)
            ends.append((node, context))
            return node

        yield advertise
        for node, context in ends:
            node.destroy_node()
            context.try_shutdown()

    @pytest.fixture
    def listener(self, ros, own_domain):
        """A node of the same graph."""
        with RawTopics("listener") as listener:
            yield listener

    def wait(self, listener, condition):
        give_up_s = time.monotonic() + PATIENCE_S
        while not (result := condition()):
            assert time.monotonic() < give_up_s
            listener.spin_for(0.05)
        return result

    def test_clouds_of_scene_flow_nodes_are_no_candidates(self, advertise, listener):
        advertise("lidar", points=PointCloud2, scan=LaserScan)
        outputs = dict.fromkeys(("motion", "flow__flow", "flow__objects"), PointCloud2)
        advertise("flow", **outputs, flow__explanation=DiagnosticArray)
        advertise("player", scene_flow__flow__moving=PointCloud2)  # of a recording
        search = CloudSearch(listener.node)
        assert self.wait(listener, search.found) == "/points"
        # Nobody publishes clouds there, but somebody waits for them.
        advertise("viewer").create_subscription(PointCloud2, "/wanted", print, 1)
        advertise("rear", rear=PointCloud2)
        self.wait(listener, lambda: cloud_topics(listener.node) == ["/points", "/rear"])
        assert search.found() is None

    def test_why_no_cloud_comes(self, advertise, listener):
        def fault(topic, reliability=ReliabilityPolicy.BEST_EFFORT):
            return fault_of(listener.node, topic, QoSProfile(depth=1, reliability=reliability))

        advertise("driver", points=PointCloud2, scan=LaserScan)
        assert fault("/nothing") == ""
        assert self.wait(listener, lambda: fault("/scan")) == (
            "/scan is a sensor_msgs/msg/LaserScan"
        )
        assert fault("/points") == "/points is published, but nothing arrives"
        weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        advertise("weak").create_publisher(PointCloud2, "/weak", weak)
        self.wait(listener, lambda: fault("/weak"))
        assert fault("/weak", ReliabilityPolicy.RELIABLE) == (
            "/weak is published in another quality of service: Best effort publisher and "
            "reliable subscription"
        )


class TestTopicThatNobodyNamed:
    """A real node without a remapping looks for the lidar by itself."""

    @pytest.fixture
    def lidar(self, own_domain):
        with RawTopics("lidar") as lidar:
            yield lidar

    @pytest.fixture
    def process(self, own_domain, start_node):
        process = start_node(QUICK | {"node.stale_after_s": 0.5})
        yield process
        process.end()

    def flow_of(self, lidar, process, topic, msgtype, message):
        """Publishes clouds, by their number, on a topic until there is flow of them."""
        flows, publisher = [], lidar.publisher(topic, msgtype)
        lidar.subscribe("/scene_flow/flow", CLOUD_TYPE, flows.append)
        for index in itertools.count():
            publisher.publish(message(index))
            lidar.spin_for(0.1)
            if flows:
                break
            assert process.is_running, process.log
            assert index < 10 * PATIENCE_S, process.log
        assert process.log.count(f"sweeps from {topic}, the only topic of clouds") == 1
        return flows[0]

    def test_is_the_only_one_with_clouds(self, lidar, process, drive):
        self.flow_of(lidar, process, "/lidar/points", CLOUD_TYPE, drive.sweep)

    def test_may_have_compressed_clouds_where_their_package_is_installed(
        self, lidar, process, drive
    ):
        messages = pytest.importorskip("point_cloud_interfaces.msg")

        def compressed(index):
            cloud = drive.sweep(index)
            values = {name: getattr(cloud, name) for name in cloud.get_fields_and_field_types()}
            data = zlib.compress(values.pop("data"))
            return messages.CompressedPointCloud2(
                **values, format="zlib", compressed_data=array.array("B", data)
            )

        flow = self.flow_of(lidar, process, "/points/zlib", COMPRESSED_TYPE, compressed)
        assert flow.width == drive.sweep(0).width

    def test_is_asked_for_where_there_are_several(self, lidar, process):
        messages = []
        lidar.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", messages.append)
        for topic in ("/rear", "/front"):
            lidar.publisher(topic, CLOUD_TYPE)
        expected = (
            "no sweep on any topic: clouds are on /front, /rear: name one of them "
            "(node: remap ~/points; launch: points:=TOPIC)"
        )
        give_up_s = time.monotonic() + PATIENCE_S
        while not messages or messages[-1].status[0].message != expected:
            assert time.monotonic() < give_up_s, process.log
            lidar.spin_for(0.1)
        lidar.spin_for(2.0)  # far more than it takes to settle
        assert messages[-1].status[0].message == expected
        assert "waits for the only topic of clouds, flow on /scene_flow/flow" in process.log
