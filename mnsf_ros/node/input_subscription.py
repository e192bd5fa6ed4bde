"""The subscription to the lidar, with the reliability that its publishers offer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

# Callbacks only decode and hand over, so waiting messages mean a short stall, not a queue.
_DEPTH = 5


class InputSubscription:
    """Subscribes best effort, or reliable where every publisher is.

    Reliable transport loses no large clouds, but a reliable subscription gets nothing from a
    best-effort publisher. `BEST_AVAILABLE` decides once, often before the publisher is there, so
    this looks again and again: call `refresh` from a timer.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        reliability: str,
        on_cloud: Callable[[PointCloud2], None],
        on_lost: Callable[[int], None],
    ) -> None:
        """Subscribes.

        Args:
            node: The node.
            topic: Name of the topic, before remapping.
            reliability: `auto`, `reliable` or `best_effort`.
            on_cloud: Gets each message.
            on_lost: Gets the number of messages that the transport has just lost.
        """
        self._node = node
        self._topic = topic
        self._wanted = reliability
        self._on_cloud = on_cloud
        self._on_lost = on_lost
        self._is_reliable = reliability == "reliable"
        self._subscription = self._subscribe()

    @property
    def topic(self) -> str:
        """Full name of the topic, after remapping."""
        return str(self._subscription.topic_name)

    @property
    def reliability(self) -> str:
        """`reliable` or `best_effort`, as subscribed now."""
        return "reliable" if self._is_reliable else "best_effort"

    @property
    def num_publishers(self) -> int:
        """Publishers of the topic that can be seen now."""
        return int(self._node.count_publishers(self.topic))

    def refresh(self) -> bool:
        """Subscribes anew if the publishers offer something else; True if it did."""
        if self._wanted != "auto":
            return False
        offered = self._node.get_publishers_info_by_topic(self.topic)
        # Without publishers best effort, which suits whichever comes.
        all_reliable = bool(offered) and all(
            info.qos_profile.reliability == ReliabilityPolicy.RELIABLE for info in offered
        )
        if all_reliable == self._is_reliable:
            return False
        self._is_reliable = all_reliable
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe()
        return True

    def _subscribe(self) -> Any:  # noqa: ANN401 - rclpy's type differs between releases
        policy = ReliabilityPolicy.RELIABLE if self._is_reliable else ReliabilityPolicy.BEST_EFFORT
        return self._node.create_subscription(
            PointCloud2,
            self._topic,
            self._on_cloud,
            QoSProfile(depth=_DEPTH, reliability=policy),
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_message_lost),
        )

    def _on_message_lost(self, event: QoSMessageLostInfo) -> None:
        self._on_lost(int(event.total_count_change))
