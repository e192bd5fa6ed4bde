"""What was added to a node since some time: topics, services and timers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from rclpy.node import Node


class AddedEntities:
    """Remembers what a node has, to destroy what it has more of later.

    So nothing is forgotten, also where only a part could be added before an error.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._before = {id(entity) for entity, _ in self._all()}

    def destroy(self) -> None:
        """Destroys all that was added."""
        for entity, destroy in list(self._all()):
            if id(entity) not in self._before:
                destroy(entity)

    def _all(self) -> Iterator[tuple[Any, Callable[[Any], object]]]:
        """All entities of the node, and what destroys them."""
        node = self._node
        for entities, destroy in (
            (node.timers, node.destroy_timer),
            (node.subscriptions, node.destroy_subscription),
            (node.services, node.destroy_service),
            (node.clients, node.destroy_client),
            (node.publishers, node.destroy_publisher),
        ):
            for entity in entities:
                yield entity, destroy
