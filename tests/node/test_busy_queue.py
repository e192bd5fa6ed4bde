# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds that a busy node's queue overwrites are counted."""

from __future__ import annotations

import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from synthetic_clouds import surfaces, xyz_message
from waiting import PATIENCE_S

from mnsf_ros.node.subscriptions import InputSubscription


def test_clouds_that_come_while_the_node_is_busy(ros):
    node = rclpy.create_node("busy")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    reliable = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
    publisher = node.create_publisher(PointCloud2, "~/points", reliable)
    received, missed = [], []
    subscription = InputSubscription(
        node,
        "~/points",
        "reliable",
        received.append,
        lambda event, _text, how_many: missed.append((event, how_many)),
        lambda callback: callback,
    )

    def publish(index):
        publisher.publish(xyz_message(surfaces(index, 12), stamp_ns=10**9 + index * 10**8))

    def spin_until(condition):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up
            executor.spin_once(timeout_sec=0.02)

    spin_until(lambda: publisher.get_subscription_count() == subscription.num_publishers == 1)
    publish(0)
    spin_until(lambda: len(received) == 1)
    for index in range(1, 41):
        publish(index)
    spin_until(lambda: received[-1].header.stamp.sec == 5)
    executor.shutdown()
    node.destroy_node()
    assert {event for event, _ in missed} == {"clouds_missed"}
    num_missed = sum(how_many for _, how_many in missed)
    assert num_missed >= 20
    assert len(received) + num_missed == 41
