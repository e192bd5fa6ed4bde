# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The metadata.yaml of a rosbag2 folder: read as far as it is needed, and written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from mnsf_ros.recording.bag_files import METADATA_NAME

_ROOT: Final = "rosbag2_bagfile_information"
_MOST: Final = 2**63


@dataclass(frozen=True)
class Metadata:
    """Promises of the metadata.yaml of a folder: its files, and the messages of each topic."""

    files: list[Path]
    counts: Counter[str]


def read_metadata(folder: Path) -> Metadata | None:
    """Reads the metadata.yaml of a folder; None if it has none.

    Raises:
        OSError, ValueError, LookupError, TypeError, RecursionError: It cannot be read, or has
            another content.
    """
    file = folder / METADATA_NAME
    if not file.is_file():
        return None
    try:
        content = YAML(typ="safe").load(file.read_text("utf-8"))[_ROOT]
    except YAMLError as error:
        text = getattr(error, "problem", None) or type(error).__name__
        raise ValueError(f"YAML error: {text}") from error
    counts: Counter[str] = Counter()
    for topic in content["topics_with_message_count"]:
        if not 0 <= topic["message_count"] < _MOST:
            raise ValueError("a message_count is out of range")
        counts[str(topic["topic_metadata"]["name"])] += topic["message_count"]
    # Whatever folders a path names, only this one is looked into.
    files = [folder / PurePath(name).name for name in content["relative_file_paths"]]
    return Metadata(files, counts)


@dataclass
class WrittenTopic:
    """A topic of a recording being written, with its channel in the mcap file."""

    name: str
    msgtype: str
    type_hash: str
    channel: int
    count: int = 0

    def described(self) -> dict[str, Any]:
        """Returns its entry in metadata.yaml."""
        return {
            "topic_metadata": {
                "name": self.name,
                "type": self.msgtype,
                "serialization_format": "cdr",
                "offered_qos_profiles": [],
                "type_description_hash": self.type_hash,
            },
            "message_count": self.count,
        }


def write_metadata(
    file: Path, topics: Collection[WrittenTopic], first_ns: int, end_ns: int
) -> None:
    """Writes the metadata.yaml for a folder with one mcap file, beside it.

    Raises:
        OSError: It cannot be written.
    """
    extent = {
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "duration": {"nanoseconds": end_ns - first_ns},
        "message_count": sum(topic.count for topic in topics),
    }
    content = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": [file.name],
        **extent,
        "topics_with_message_count": [topic.described() for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": file.name, **extent}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    # The same table may occur twice: written twice, not as a reference.
    yaml.representer.ignore_aliases = lambda _: True
    yaml.dump({_ROOT: content}, file.with_name(METADATA_NAME))
