# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The lidar's topic is found where there is only one."""

from __future__ import annotations

import pytest
import rclpy
from nav_msgs.msg import Odometry
from rclpy.context import Context
from sensor_msgs.msg import PointCloud2

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.cloud_topics import only_cloud_topic


@pytest.fixture
def node(ros, other_domain):
    """A node whose topics are all that there is; they are seen at once in one process."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("lidars", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def publish(node):
    """Advertises topics."""
    return lambda *topics: [node.create_publisher(PointCloud2, topic, 1) for topic in topics]


def is_found(wanted):
    """Whether a search finds it that lasts as long as this machine needs."""
    return any(wanted in _found(search_s) for search_s in (0.5, 2.0, 8.0, 32.0))


def _found(search_s):
    try:
        return only_cloud_topic(search_s)
    except SettingsError as error:
        return str(error)


def test_the_only_one_is_taken(publish):
    publish("/lidar/points", "/scene_flow/flow", "/scene_flow/flow/moving", "/scene_flow/objects")
    assert is_found("/lidar/points")


def test_several_are_listed(publish):
    publish("/rear/points", "/front/points")
    assert is_found("several PointCloud2 topics: /front/points, /rear/points; give points:=TOPIC")


def test_none_is_said(node):
    node.create_publisher(Odometry, "/odom", 1)
    node.create_subscription(PointCloud2, "/wanted/points", print, 1)
    with pytest.raises(SettingsError, match="no PointCloud2 topic is published"):
        only_cloud_topic(search_s=0.5)
