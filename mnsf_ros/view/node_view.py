# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Topics of a running node, forwarded to viewers while they subscribe."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.view.view_server import ViewServer

_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
_TIMES: Final = ("processing_time", "pipeline_latency", "cyclic_time")
# Of the topics below the name of the node.
_TYPES: Final = {
    "/flow": _CLOUD,
    "/flow/moving": _CLOUD,
    "/flow/standing": _CLOUD,
    "/objects/markers": "visualization_msgs/msg/MarkerArray",
    "/ego_motion": "nav_msgs/msg/Odometry",
    **{f"/debug/{name}_ms": "std_msgs/msg/Float64" for name in _TIMES},
}
_DIAGNOSTICS: Final = ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
_REFRESH_S: Final = 0.5


class NodeView:
    """Hands the messages of a node on to viewers."""

    def __init__(self, server: ViewServer, ros: RawTopics, node: str) -> None:
        """Advertises the topics of a node, by its full name such as `/scene_flow`."""
        self._ros = ros
        self._types = {f"{node}{end}": msgtype for end, msgtype in _TYPES.items()}
        self._types[_DIAGNOSTICS[0]] = _DIAGNOSTICS[1]
        self._channels = {
            topic: server.channel(topic, msgtype) for topic, msgtype in self._types.items()
        }
        self._subscriptions: dict[str, Any] = {}

    def run(self) -> Iterator[int]:
        """Forwards messages; yields the number of topics with viewers."""
        while True:
            self._refresh()
            self._ros.spin_for(_REFRESH_S)
            yield len(self._subscriptions)

    def _refresh(self) -> None:
        for topic, channel in self._channels.items():
            is_watched = channel.has_sinks()
            if is_watched and topic not in self._subscriptions:
                self._subscriptions[topic] = self._ros.subscribe(
                    topic, self._types[topic], channel.log
                )
            elif not is_watched and topic in self._subscriptions:
                self._ros.unsubscribe(self._subscriptions.pop(topic))
