# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which topics of the ROS graph have clouds, and why none arrive on one."""

import time
from collections.abc import Collection
from contextlib import suppress
from typing import Any, Final

from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from sensor_msgs.msg import PointCloud2

from mnsf_ros.node.raw_topics import MessageTypeError, message_class
from msg_utils.other_clouds import CLOUD_TYPE, COMPRESSED_TYPE, LIVOX_TYPES

# Nodes that play recordings, whose stamps are old.
OWN_PLAYER: Final = "mnsf_play"
PLAYERS: Final = frozenset({OWN_PLAYER, "rosbag2_player"})
# Clouds of a scene flow node, which may also be those of a recording that is played.
_OWN_ENDS: Final = (
    *("/flow", "/flow/moving", "/flow/standing"),
    *("/objects", "/predicted", "/predicted/clearing"),
)
# That only such a node publishes.
_OWN_MARK: Final = "/explanation"
# What makes clouds of other types usable.
_ADVICE: Final = {
    COMPRESSED_TYPE: ", whose package is not installed",
    **dict.fromkeys(LIVOX_TYPES, "; set xfer_format: 0 in the driver"),
}
# Nodes need a while to find each other; one more topic may turn up until then.
_SETTLE_S: Final = 0.5


def cloud_class(types: Collection[str]) -> Any:  # noqa: ANN401 - a class of ROS, or None
    """Returns the class of the first type of clouds that can be subscribed to; None without one."""
    if CLOUD_TYPE in types:
        return PointCloud2
    if COMPRESSED_TYPE in types:
        with suppress(MessageTypeError):
            return message_class(COMPRESSED_TYPE)
    return None


def cloud_topics(node: Node) -> list[str]:
    """Returns the topics of clouds that are published, but by scene flow nodes.

    Compressed ones are left out where others are there: most are copies.
    """
    classes = {
        name: cloud_class(_published_types(node, name))
        for name, types in node.get_topic_names_and_types()
        if cloud_class(types) is not None and not name.endswith(_OWN_ENDS)
    }
    raw = sorted(name for name, found in classes.items() if found is PointCloud2)
    return raw or sorted(name for name, found in classes.items() if found is not None)


def unusable_topics(node: Node) -> list[str]:
    """Returns a text for each topic of clouds that cannot be subscribed to."""
    return [
        f"{name} is a {kind}{_ADVICE[kind]}"
        for name, types in node.get_topic_names_and_types()
        for kind in types
        if kind in _ADVICE and cloud_class([kind]) is None
    ]


def _published_types(node: Node, topic: str) -> set[str]:
    """A subscriber's type is none of these."""
    publishers = node.get_publishers_info_by_topic(topic)
    return {info.topic_type for info in publishers if not _is_of_scene_flow(node, info)}


def _is_of_scene_flow(node: Node, publisher: Any) -> bool:  # noqa: ANN401 - of rclpy
    place = publisher.node_name, publisher.node_namespace
    if not place[1].startswith("/"):
        return False  # not known yet, or no node of ROS
    try:
        names = node.get_publisher_names_and_types_by_node(*place)
    except NodeNameNonExistentError:
        return False
    return any(name.endswith(_OWN_MARK) for name, _ in names)


class CloudSearch:
    """Looks for the only topic of clouds."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._topics: list[str] = []
        self._since_s = time.monotonic()

    def found(self) -> str | None:
        """Returns the topic, once it was the only one for half a second; call it repeatedly."""
        topics, now_s = cloud_topics(self._node), time.monotonic()
        if topics != self._topics:
            self._topics, self._since_s = topics, now_s
        is_settled = now_s - self._since_s >= _SETTLE_S
        return topics[0] if len(topics) == 1 and is_settled else None


def fault_of(node: Node, topic: str, subscribed: QoSProfile) -> str:
    """Returns why no clouds arrive on a topic that is published; empty if it is not published."""
    publishers = node.get_publishers_info_by_topic(topic)
    types = {info.topic_type for info in publishers}
    if not types:
        return ""
    if cloud_class(types) is None:
        return f"{topic} is a " + ", ".join(name + _ADVICE.get(name, "") for name in sorted(types))
    for info in publishers:
        compatibility, reason = qos_check_compatible(info.qos_profile, subscribed)
        if compatibility == QoSCompatibility.ERROR:
            reason = reason.removeprefix("ERROR: ").rstrip("; ")
            return f"{topic} is published in another quality of service: {reason}"
    return f"{topic} is published, but nothing arrives"
