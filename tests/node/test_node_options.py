# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A node in a namespace, with a frame and qualities of service of its own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import rclpy
from nav_msgs.msg import Odometry
from rclpy.qos import ReliabilityPolicy
from scene_flow_process import QUICK
from std_msgs.msg import Float64

NAME = "/front/street"
DEBUG_TOPICS = ("processing_time_ms", "pipeline_latency_ms", "cyclic_time_ms")


@pytest.fixture(scope="module")
def process(start_node):
    options = {
        "node.odom_frame": "front/odom",
        f"qos_overrides.{NAME}/flow/moving.publisher.reliability": "best_effort",
        f"qos_overrides.{NAME}/points.subscription.depth": 2,
        f"qos_overrides.{NAME}/points.subscription.reliability": "reliable",
    }
    process = start_node(QUICK | options, "-r", "__ns:=/front", "-r", "__node:=street")
    yield process
    assert process.stop() == 0
    assert "Traceback" not in process.log


@pytest.fixture(scope="module")
def named_peer(process, make_peer):
    peer = make_peer(process, node_name=NAME)
    peer.wait_for_node()
    return peer


def test_has_the_full_name_in_the_diagnostics(named_peer):
    assert named_peer.status("flow").name == "front/street: flow"
    assert named_peer.status("flow").hardware_id == "/front/street/points"


def test_has_a_frame_of_its_own(named_peer, drive):
    heard = []
    subscription = named_peer.node.create_subscription(
        Odometry, f"{NAME}/ego_motion", heard.append, 10
    )
    named_peer.spin_until(lambda: subscription.get_publisher_count() == 1, "ego motion")
    # The node may find the subscription late.
    named_peer.send_until(map(drive.sweep, itertools.count()), lambda: heard, "ego motion")
    named_peer.node.destroy_subscription(subscription)
    assert heard[0].header.frame_id == "front/odom"


def test_publishes_its_times(named_peer, drive):
    heard = {name: [] for name in DEBUG_TOPICS}
    subscriptions = [
        named_peer.node.create_subscription(Float64, f"{NAME}/debug/{name}", heard[name].append, 10)
        for name in DEBUG_TOPICS
    ]
    for subscription in subscriptions:
        named_peer.spin_until(lambda s=subscription: s.get_publisher_count() == 1, "debug topics")
    named_peer.send_until(
        map(drive.sweep, itertools.count()), lambda: all(heard.values()), "all times"
    )
    named_peer.wait_until_settled()
    for subscription in subscriptions:
        named_peer.node.destroy_subscription(subscription)
    processing, latency, cycle = (heard[name][-1].data for name in DEBUG_TOPICS)
    assert 0 < processing < latency
    assert np.isfinite(cycle)
    assert cycle > 0


def test_takes_qualities_of_service_of_the_user(named_peer, process):
    (moving,) = named_peer.node.get_publishers_info_by_topic(f"{NAME}/flow/moving")
    assert moving.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    (standing,) = named_peer.node.get_publishers_info_by_topic(f"{NAME}/flow/standing")
    assert standing.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert named_peer.get(f"qos_overrides.{NAME}/points.subscription.depth") == 2
    (unknown,) = (line for line in process.log.splitlines() if "unknown parameter" in line)
    assert "points.subscription.reliability" in unknown
    assert "set node.input_reliability" in unknown


def test_says_once_that_another_node_has_its_name(named_peer, process):
    text = f"another node is called {NAME}, too"
    assert text not in process.log
    namesake = rclpy.create_node("street", namespace="/front")
    named_peer.spin_until(lambda: text in process.log, "the warning")
    num_statuses = len(named_peer.diagnostics)
    named_peer.spin_until(lambda: len(named_peer.diagnostics) > num_statuses + 3, "diagnostics")
    namesake.destroy_node()
    assert process.log.count(text) == 1
