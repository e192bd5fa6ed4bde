"""What topics an open recording really holds, and which of them is wanted."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.reader import Reader as Ros2Reader
from rosbags.rosbag2.storage_mcap import McapReader

from mnsf_ros.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from rosbags.highlevel import AnyReader


@dataclass(frozen=True)
class TopicSummary:
    """What a topic of a recording holds.

    Attributes:
        msgtype: For example `sensor_msgs/msg/PointCloud2`, also in ROS 1 bags.
        count: Number of messages that are stored.
    """

    msgtype: str
    count: int


def summarize(path: Path, source: AnyReader) -> dict[str, TopicSummary]:
    """Return topic name -> summary of an open recording, sorted by name.

    The counts are those of the storage files: a metadata.yaml may promise something else.

    Args:
        path: The recording, for error texts.
        source: The same, open.

    Raises:
        RecordingError: It holds no messages, or its metadata.yaml hides some of its topics.
    """
    counts: Counter[str] = Counter()
    for storage in _storages(source):
        for connection in storage.connections:
            counts[connection.topic] += connection.msgcount
    types: dict[str, set[str]] = {}
    for connection in source.connections:
        types.setdefault(connection.topic, set()).add(connection.msgtype)
    hidden = sorted(topic for topic in counts if counts[topic] and topic not in types)
    if hidden:
        raise RecordingError(
            f"{path}: its metadata.yaml does not list {', '.join(hidden)}, which its files hold; "
            "delete metadata.yaml to read them without it"
        )
    if not any(counts.values()):
        raise RecordingError(f"{path}: holds no messages")
    return {
        topic: TopicSummary(" and ".join(sorted(types[topic])), counts[topic])
        for topic in sorted(types)
    }


def find_topic(
    path: Path, topics: Mapping[str, TopicSummary], name: str | None, msgtype: str
) -> str:
    """Return the topic to read.

    Args:
        path: The recording, for error texts.
        topics: What it holds.
        name: A topic, or None for the only topic of this type that has messages.
        msgtype: The type that is needed.

    Raises:
        RecordingError: There is no such topic, it is of another type or empty, or there are
            several to choose from.
    """
    if name is not None:
        summary = known_topic(path, topics, name)
        if summary.msgtype != msgtype:
            raise RecordingError(
                f"{path}: topic {name!r} is of type {summary.msgtype}, expected {msgtype}"
            )
        if summary.count == 0:
            raise RecordingError(f"{path}: topic {name!r} holds no messages")
        return name
    found = [topic for topic, s in topics.items() if s.msgtype == msgtype and s.count > 0]
    if not found:
        raise RecordingError(f"{path}: no topic of type {msgtype}; {_listing(topics)}")
    if len(found) > 1:
        names = ", ".join(found)
        raise RecordingError(f"{path}: {len(found)} topics of type {msgtype}: name one of {names}")
    return found[0]


def known_topic(path: Path, topics: Mapping[str, TopicSummary], name: str) -> TopicSummary:
    """Return the summary of a topic.

    Raises:
        RecordingError: There is no such topic; the text lists those that exist.
    """
    if name not in topics:
        raise RecordingError(f"{path}: no topic {name!r}; {_listing(topics)}")
    return topics[name]


def shares_position(source: AnyReader) -> bool:
    """Tell whether two scans of the source at a time would disturb each other.

    An mcap file without an index is scanned from one position that all scans share: each would
    silently skip what the other one reads.
    """
    return any(isinstance(s, McapReader) and not s.chunks for s in _storages(source))


def _storages(source: AnyReader) -> list[Any]:
    """Return the readers of the single files."""
    storages: list[Any] = []
    for reader in source.readers:
        storage = reader.storage if isinstance(reader, Ros2Reader) else reader
        storages += storage.storages if isinstance(storage, DirectoryReader) else [storage]
    return storages


def _listing(topics: Mapping[str, TopicSummary]) -> str:
    listed = ", ".join(f"{name} ({summary.msgtype})" for name, summary in topics.items())
    return f"it has {listed}"
