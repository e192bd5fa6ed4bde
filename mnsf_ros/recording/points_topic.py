"""Which topic of a recording has the sweeps."""

from __future__ import annotations

from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.conventions import CLOUD_TYPE, POINTS_TOPIC, TRUTH_FLOW_TOPIC


def find_points_topic(reader: BagReader, name: str | None) -> str:
    """The topic of the sweeps: the one named, or the only one that it can be.

    Args:
        reader: An open recording.
        name: What the user named, or None.

    Raises:
        RecordingError: If there is no such topic, or there are several to choose from.
    """
    if name is None and {POINTS_TOPIC, TRUTH_FLOW_TOPIC} <= reader.topics.keys():
        name = POINTS_TOPIC
    return reader.find_topic(name, CLOUD_TYPE)
