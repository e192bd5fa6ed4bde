# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags, whose messages are converted to those of ROS 2."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag1
from rosbags.typesys.store import Typestore

from mnsf_ros.errors import UNREADABLE
from mnsf_ros.recording.bag_topics import TopicSummary, add_topic, jazzy
from mnsf_ros.recording.damage import Damage


class Ros1File:
    """A ROS 1 bag with an index, see `StorageFile`."""

    has_checksums = False

    def __init__(self, path: Path) -> None:
        """Reads the index of a bag.

        Raises:
            Exception: One of `UNREADABLE`: it is damaged or no ROS 1 bag with an index.
        """
        self.topics: dict[str, TopicSummary] = {}
        self.damages: list[Damage] = []
        self._path = path
        with AnyReader([path]) as bag:
            self.first_ns: float = bag.start_time
            self.last_ns: float = bag.end_time - 1  # it is behind the last message
            for one in bag.connections:
                is_latched = isinstance(one.ext, ConnectionExtRosbag1) and bool(one.ext.latching)
                summary = TopicSummary(one.msgtype, one.msgcount, is_latched)
                add_topic(self.topics, one.topic, summary)

    def messages(self, topic: str, start_ns: float) -> Iterator[tuple[int, bytes] | Damage]:
        """Yields receive time and CDR bytes of the messages from a time on, or a Damage.

        Each scan opens the bag: rosbags keeps one chunk, and scans side by side would have it
        expanded again for every message.
        """
        count = 0
        try:
            with AnyReader([self._path]) as bag:
                connections = [one for one in bag.connections if one.topic == topic]
                for found, received_ns, raw in bag.messages(connections):
                    if received_ns < start_ns:
                        continue
                    count += 1
                    try:
                        yield received_ns, _cdr(raw, found.msgtype, bag.typestore)
                    except UNREADABLE as error:
                        text = f"message {count} on {topic!r} cannot be read"
                        yield Damage.of(self._path, "", error, text)
        except UNREADABLE as error:
            text = f"damaged after {count} messages on {topic!r}"
            yield Damage.of(self._path, "", error, text)


def _cdr(raw: bytes, msgtype: str, ros1: Typestore) -> bytes:
    """A ROS 1 message as CDR bytes; fields that ROS 2 has not, such as `seq`, are left out.

    Raises:
        ValueError: ROS 2 has no type of this name, or one with further fields.
    """
    message = ros1.deserialize_ros1(raw, msgtype)
    try:
        return bytes(jazzy().serialize_cdr(message, msgtype))
    except (AttributeError, KeyError) as error:
        raise ValueError(f"ROS 1 type {msgtype} has no equal in ROS 2 Jazzy") from error
