# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The topics of clouds that are published, beside those of this package."""

from __future__ import annotations

from typing import Final

from rclpy.node import Node

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.raw_topics import RawTopics

_CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
# Clouds that a scene flow node publishes.
_OWN_ENDS: Final = ("/flow", "/flow/moving", "/flow/standing", "/objects")
# Nodes need a while to find each other; one more cloud may turn up until then.
_SEARCH_S: Final = 3.0


def only_cloud_topic(search_s: float = _SEARCH_S) -> str:
    """Returns the topic of the only publisher of clouds, beside those of this package.

    Raises:
        SettingsError: If there is none, or more than one; it names them.
    """
    with RawTopics("scene_flow_search") as ros:
        ros.spin_for(search_s)
        topics = cloud_topics(ros.node)
    if len(topics) == 1:
        return topics[0]
    if topics:
        raise SettingsError(f"several PointCloud2 topics: {', '.join(topics)}; give points:=TOPIC")
    raise SettingsError(
        f"no PointCloud2 topic is published, as seen in {search_s:g} s; start the lidar first, or "
        "give points:=TOPIC"
    )


def cloud_topics(node: Node) -> list[str]:
    """Returns the published topics of clouds that a node sees, beside those of this package."""
    return sorted(
        name
        for name, types in node.get_topic_names_and_types()
        if _CLOUD_TYPE in types and not name.endswith(_OWN_ENDS) and node.count_publishers(name) > 0
    )
