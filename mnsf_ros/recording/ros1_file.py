# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags, whose messages are converted to ROS 2."""

from collections.abc import Iterator
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag1
from rosbags.typesys.store import Typestore

from mnsf_ros.errors import UNREADABLE
from mnsf_ros.recording.bag_topics import TopicSummary, add_topic, jazzy
from mnsf_ros.recording.storage_file import Damage, Readable, StorageFile


class Ros1File(StorageFile):
    """A ROS 1 bag with an index.

    Each scan opens the bag: rosbags keeps one chunk, and scans side by side would have it expanded
    again for every message.
    """

    def __init__(self, path: Path) -> None:
        """Reads the index."""
        super().__init__(path)
        with AnyReader([path]) as bag:
            self.first_ns = bag.start_time
            self.last_ns = bag.end_time - 1  # it is behind the last message
            for one in bag.connections:
                is_latched = isinstance(one.ext, ConnectionExtRosbag1) and bool(one.ext.latching)
                summary = TopicSummary(one.msgtype, one.msgcount, is_latched)
                add_topic(self.topics, one.topic, summary)

    def messages(self, topic: str, start_ns: float) -> Iterator[Readable[bytes]]:
        """Yields receive time and CDR bytes of the messages from a time on, or a Damage."""
        with AnyReader([self.path]) as bag:
            connections = [one for one in bag.connections if one.topic == topic]
            for found, received_ns, raw in bag.messages(connections):
                if received_ns < start_ns:
                    continue
                try:
                    yield received_ns, _cdr(raw, found.msgtype, bag.typestore)
                except UNREADABLE as error:
                    text = f"a message on {topic!r} cannot be read"
                    yield Damage.of(self.path, "", error, text)


def _cdr(raw: bytes, msgtype: str, ros1: Typestore) -> bytes:
    """A ROS 1 message as CDR bytes; fields that ROS 2 has not, such as `seq`, are left out."""
    message = ros1.deserialize_ros1(raw, msgtype)
    try:
        return bytes(jazzy().serialize_cdr(message, msgtype))
    except (AttributeError, KeyError) as error:
        raise ValueError(f"ROS 1 type {msgtype} has no equal in ROS 2 Jazzy") from error
