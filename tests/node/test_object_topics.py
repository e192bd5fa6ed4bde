# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Objects on the topics of a real node, to those that subscribe."""

from __future__ import annotations

import time

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2
from synthetic_clouds import column, surfaces, xyz_message
from tracked_objects import tracked
from visualization_msgs.msg import Marker, MarkerArray
from waiting import PATIENCE_S

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.node.flow_outputs import FlowOutputs
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import sweep_from_message

NUM_POINTS = 60
TOPICS = {"/outputs/objects": PointCloud2, "/outputs/objects/markers": MarkerArray}


@pytest.fixture
def node(ros):
    node = rclpy.create_node("outputs")
    yield node
    node.destroy_node()


@pytest.fixture
def outputs(node):
    return FlowOutputs(node, "odom")


@pytest.fixture
def hear(node):
    """Subscribes to a topic, and waits until it has as many messages as it should."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin_until(condition):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up
            executor.spin_once(timeout_sec=0.02)

    def start(topic):
        heard = []
        subscription = node.create_subscription(TOPICS[topic], topic, heard.append, 10)
        spin_until(lambda: subscription.get_publisher_count() > 0)

        def wait_for(num):
            spin_until(lambda: len(heard) >= num)
            return heard

        return wait_for

    yield start
    executor.shutdown()


def triplet():
    messages = [
        xyz_message(surfaces(index, NUM_POINTS), stamp_ns=10**9 + index * 10**8)
        for index in range(3)
    ]
    return SweepTriplet(*(sweep_from_message(message, Settings().time, 0) for message in messages))


def estimate(objects, *, knows_objects=True):
    over_ground = OverGround(
        motion=np.zeros((NUM_POINTS, 3), np.float32),
        dynamic=np.zeros(NUM_POINTS, bool),
        confidence=np.ones(NUM_POINTS, np.float32),
        world_from_sensor=np.eye(4),
        next_from_current=np.eye(4),
        source="registration",
        objects=tuple(objects),
        track_ids=np.zeros(NUM_POINTS, np.int32) if knows_objects else None,
    )
    flow = np.zeros((NUM_POINTS, 3), np.float32)
    return FlowEstimate(flow, np.ones(NUM_POINTS, bool), over_ground=over_ground)


def test_objects_have_the_header_of_their_sweep(outputs, hear):
    cloud, markers = (hear(topic) for topic in TOPICS)
    sweeps = triplet()
    outputs.publish(sweeps, estimate([tracked(5)]))
    header = sweeps.current.source.message.header
    (of_cloud,), (of_markers,) = cloud(1), markers(1)
    assert of_cloud.header == header
    assert column(of_cloud, "id").tolist() == [5]
    assert {marker.header.frame_id for marker in of_markers.markers} == {"lidar"}
    assert all(marker.header == header for marker in of_markers.markers)


def test_a_sweep_without_objects_says_so(outputs, hear):
    cloud, markers = (hear(topic) for topic in TOPICS)
    outputs.publish(triplet(), estimate([tracked(5)]))
    cloud(1), markers(1)
    outputs.publish(triplet(), estimate([]))
    assert cloud(2)[1].width == 0
    gone = markers(2)[1].markers
    assert {(marker.id, marker.action) for marker in gone} == {(5, Marker.DELETE)}


def test_a_method_that_knows_no_objects_publishes_none(outputs, hear):
    cloud = hear("/outputs/objects")
    outputs.publish(triplet(), estimate([], knows_objects=False))
    outputs.publish(triplet(), estimate([tracked(6)]))
    assert column(cloud(1)[0], "id").tolist() == [6]


@pytest.mark.parametrize("topic", TOPICS)
def test_a_subscriber_of_objects_alone_is_enough_to_work_for(outputs, hear, topic):
    assert not outputs.are_watched
    hear(topic)
    give_up = time.monotonic() + PATIENCE_S
    while not outputs.are_watched:
        assert time.monotonic() < give_up
