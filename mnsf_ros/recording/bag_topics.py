# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Topics of a recording: usual names and types, and selection; see `docs/recordings.md`."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mnsf_ros.errors import RecordingError
from msg_utils.other_clouds import CLOUD_TYPE, COMPRESSED_TYPE, DEFINITIONS, LIVOX_TYPES

POINTS_TOPIC: Final = "/points"
IMU_TOPIC: Final = "/imu"
TRUTH_FLOW_TOPIC: Final = "/truth/flow"
TRUTH_ODOMETRY_TOPIC: Final = "/truth/odometry"
TRUTH_OBJECTS_TOPIC: Final = "/truth/objects"
TF_TOPIC: Final = "/tf"

IMU_TYPE: Final = "sensor_msgs/msg/Imu"
# Types that are read as clouds, the first preferred.
CLOUD_TYPES: Final = (CLOUD_TYPE, COMPRESSED_TYPE, *LIVOX_TYPES)
ODOMETRY_TYPE: Final = "nav_msgs/msg/Odometry"
TF_TYPE: Final = "tf2_msgs/msg/TFMessage"

# Serialization of ROS 2; Foxglove and others store more kinds in mcap.
CDR: Final = "cdr"

LIDAR_FRAME: Final = "lidar"
ODOMETRY_FRAME: Final = "odom"

# Older recorders write the number of the enumeration.
_LATCHED: Final = re.compile(r"""\bdurability["']?:\s*["']?(1|transient_local)\b""")


@cache
def jazzy() -> Typestore:
    """The message types of ROS 2 Jazzy, and further types of clouds."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in DEFINITIONS.items():
        store.register(get_types_from_msg(definition, name))
    return store


# Packets of a lidar to what makes clouds of them.
_CONVERTERS: Final = {
    "velodyne_msgs/msg/VelodyneScan": "velodyne_transform_node of velodyne_pointcloud",
    "ouster_sensor_msgs/msg/PacketMsg": "replay.composite.launch.xml of ouster_ros",
}


def has_latched_profile(profiles: str) -> bool:
    """Whether any of the QoS profiles of the publishers of a topic is latched.

    They are YAML, but a hundred kilobytes of that take seconds to parse.
    """
    return _LATCHED.search(profiles) is not None


@dataclass(frozen=True)
class TopicSummary:
    """Type and number of messages of a topic."""

    msgtype: str  # for example `sensor_msgs/msg/PointCloud2`, also in ROS 1 bags
    count: int  # messages that are stored
    is_latched: bool = False  # late subscribers got the last message, too
    encoding: str = CDR

    def __str__(self) -> str:
        """Returns the type, and the encoding of messages that cannot be read."""
        parts = (self.msgtype, "" if self.encoding == CDR else self.encoding)
        return ", ".join(filter(None, parts))

    def has_messages(self, msgtype: str) -> bool:
        """Whether there are messages of a type that can be read."""
        return self.msgtype == msgtype and self.count > 0 and self.encoding == CDR


def add_topic(topics: dict[str, TopicSummary], name: str, found: TopicSummary) -> None:
    """Adds the messages of one file, or of a part of it, to the summary of a topic."""
    known = topics.get(name, replace(found, count=0))
    if known.encoding == found.encoding:
        is_latched = known.is_latched or found.is_latched
        topics[name] = replace(known, count=known.count + found.count, is_latched=is_latched)
    elif found.encoding == CDR:
        topics[name] = found


@dataclass(frozen=True)
class UsedTopics:
    """Topics of the sweeps, of their truth and of the sensor poses."""

    points: str
    truth: str | None
    odometry: str | None


def used_topics(
    path: Path,
    topics: Mapping[str, TopicSummary],
    points: str | None = None,
    odometry: str | None = None,
) -> UsedTopics:
    """Returns the named topics, else the usual ones; points may also be the only clouds.

    The odometry may be a topic of transforms.

    Raises:
        RecordingError: There is no such topic, or there are several to choose from.
    """

    def usual(topic: str, msgtype: str) -> str | None:
        return topic if topic in topics and topics[topic].has_messages(msgtype) else None

    truth = usual(TRUTH_FLOW_TOPIC, CLOUD_TYPE)
    if odometry is None:
        odometry = usual(TRUTH_ODOMETRY_TOPIC, ODOMETRY_TYPE)
    elif known_topic(path, topics, odometry).msgtype != TF_TYPE:
        find_topic(path, topics, odometry, ODOMETRY_TYPE)
    if truth is not None:
        points = points or usual(POINTS_TOPIC, CLOUD_TYPE)
    points = find_topic(path, topics, points, *CLOUD_TYPES)
    if points == truth:
        raise RecordingError(f"{path}: topic {points!r} cannot be both the sweeps and their truth")
    return UsedTopics(points, truth, odometry)


def find_topic(
    path: Path, topics: Mapping[str, TopicSummary], name: str | None, *msgtypes: str
) -> str:
    """Returns the named topic, else the only topic of the first type that has messages.

    Raises:
        RecordingError: There is no such topic, it is of another type or empty, or there are
            several to choose from.
    """
    if name is not None:
        summary = known_topic(path, topics, name)
        if summary.msgtype not in msgtypes:
            raise RecordingError(
                f"{path}: topic {name!r} is of type {summary.msgtype}, expected {msgtypes[0]}"
                + _advice([summary])
            )
        if summary.count == 0:
            raise RecordingError(f"{path}: topic {name!r} holds no messages")
        return name
    for msgtype in msgtypes:
        found = [topic for topic, summary in topics.items() if summary.has_messages(msgtype)]
        if len(found) == 1:
            return found[0]
        if found:
            kinds, names = f"{len(found)} topics of type {msgtype}", ", ".join(found)
            raise RecordingError(f"{path}: {kinds}: name one by --points: {names}")
    text = f"no topic of type {msgtypes[0]}; {listing(topics)}{_advice(topics.values())}"
    raise RecordingError(f"{path}: {text}")


def _advice(summaries: Iterable[TopicSummary]) -> str:
    """Returns the end of a message: the tools that make clouds of the packets, if any."""
    tools = {one.msgtype: tool for one in summaries if (tool := _CONVERTERS.get(one.msgtype))}
    return "".join(f"; {tool} makes clouds of {name}" for name, tool in tools.items())


def known_topic(path: Path, topics: Mapping[str, TopicSummary], name: str) -> TopicSummary:
    """Returns the summary of a topic.

    Raises:
        RecordingError: There is no such topic, with a list of those that exist, or its messages
            cannot be read.
    """
    if name not in topics:
        raise RecordingError(f"{path}: no topic {name!r}; {listing(topics)}")
    if (encoding := topics[name].encoding) != CDR:
        raise RecordingError(
            f"{path}: the messages of topic {name!r} are {encoding}, expected CDR of ROS 2; "
            "convert the recording"
        )
    return topics[name]


def listing(topics: Mapping[str, TopicSummary]) -> str:
    """Returns the end of a message: each topic with its type, and its encoding if not CDR."""
    return f"it has {', '.join(f'{name} ({summary})' for name, summary in topics.items())}"
