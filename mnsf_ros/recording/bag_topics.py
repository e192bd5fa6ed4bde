"""What topics a recording holds, and which of them are used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.conventions import (
    CLOUD_TYPE,
    ODOMETRY_TYPE,
    POINTS_TOPIC,
    TRUTH_FLOW_TOPIC,
    TRUTH_ODOMETRY_TOPIC,
)


@dataclass(frozen=True)
class TopicSummary:
    """What a topic of a recording holds.

    Attributes:
        msgtype: For example `sensor_msgs/msg/PointCloud2`, also in ROS 1 bags.
        count: Number of messages that are stored.
    """

    msgtype: str
    count: int


@dataclass(frozen=True)
class UsedTopics:
    """The topics of a recording that are used: the sweeps, their truth, the sensor's poses."""

    points: str
    truth: str | None
    odometry: str | None


def used_topics(
    path: Path,
    topics: Mapping[str, TopicSummary],
    points: str | None = None,
    truth: str | None = None,
    odometry: str | None = None,
) -> UsedTopics:
    """Returns which topics of a recording to use.

    Args:
        path: The recording, for error texts.
        topics: What it holds.
        points: Topic of the sweeps; None for the only one that it can be.
        truth: Topic of the true flow; None for that of `docs/recordings.md`, if it is there.
        odometry: Topic of the sensor's poses; None for that of `docs/recordings.md`, likewise.

    Raises:
        RecordingError: There is no such topic, or there are several to choose from.
    """

    def usual(topic: str, msgtype: str) -> str | None:
        summary = topics.get(topic, TopicSummary("", 0))
        return topic if summary.msgtype == msgtype and summary.count > 0 else None

    def named(topic: str | None, convention: str, msgtype: str) -> str | None:
        topic = topic or usual(convention, msgtype)
        return None if topic is None else find_topic(path, topics, topic, msgtype)

    truth = named(truth, TRUTH_FLOW_TOPIC, CLOUD_TYPE)
    if points is None and truth is not None:
        points = usual(POINTS_TOPIC, CLOUD_TYPE)
    points = find_topic(path, topics, points, CLOUD_TYPE)
    if points == truth:
        raise RecordingError(f"{path}: topic {points!r} cannot be both the sweeps and their truth")
    return UsedTopics(points, truth, named(odometry, TRUTH_ODOMETRY_TOPIC, ODOMETRY_TYPE))


def find_topic(
    path: Path, topics: Mapping[str, TopicSummary], name: str | None, msgtype: str
) -> str:
    """Returns the topic to read.

    If no name is given, that is the only topic of this type that has messages.

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
    """Returns the summary of a topic.

    Raises:
        RecordingError: There is no such topic; the text lists those that exist.
    """
    if name not in topics:
        raise RecordingError(f"{path}: no topic {name!r}; {_listing(topics)}")
    return topics[name]


def _listing(topics: Mapping[str, TopicSummary]) -> str:
    listed = ", ".join(f"{name} ({summary.msgtype})" for name, summary in topics.items())
    return f"it has {listed}"
