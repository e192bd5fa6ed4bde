# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The layout of recordings on disk: their files and metadata.yaml."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final, TypeVar

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from mnsf_ros.errors import RecordingError

Kind = TypeVar("Kind")

METADATA_NAME: Final = "metadata.yaml"
MCAP: Final = ".mcap"
ROS1: Final = ".bag"
COMPRESSED: Final = ".zstd"
SUFFIXES: Final = (MCAP, ".db3", ROS1)
_EXPECTED: Final = "a rosbag2 folder, or a .mcap, .db3 or .bag file"
_END_BYTES: Final = 2**20
_ROOT: Final = "rosbag2_bagfile_information"
_MOST: Final = 2**63
# That of 600 topics has it; what takes longest to parse takes 6 s.
_METADATA_BYTES: Final = 2**19


def stored_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, by name; none if there are none.

    The decompressed copy that `ros2 bag play` leaves beside a compressed file does not count.

    Raises:
        OSError: The folder cannot be read.
    """
    entries = sorted(path.iterdir()) if path.is_dir() else [path]
    stored = [entry for entry in entries if kind_of(entry) in SUFFIXES]
    copies = {entry.with_suffix("") for entry in stored if entry.suffix == COMPRESSED}
    return [entry for entry in stored if entry not in copies]


def kind_of(file: Path) -> str:
    """Returns the suffix of the format of a file, without that of compression."""
    return (file.with_suffix("") if file.suffix == COMPRESSED else file).suffix


def recording_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, for a recording without a metadata.yaml.

    Raises:
        RecordingError: There is no recording, or the files are of several kinds.
    """
    try:
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder; expected {_EXPECTED}")
        files = stored_files(path)
        if not files and not path.is_dir():
            raise RecordingError(f"{path}: is not a recording; expected {_EXPECTED}")
        if not files:
            raise RecordingError(f"{path}: holds no recording; {_content(sorted(path.iterdir()))}")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from error
    kinds = sorted({kind_of(file) for file in files})
    if len(kinds) > 1:
        raise RecordingError(
            f"{path}: holds {' and '.join(kinds)} files but no {METADATA_NAME}; name one file"
        )
    return files


def _content(entries: list[Path]) -> str:
    inside = [entry.name for entry in entries if (entry / METADATA_NAME).is_file()]
    if inside:
        return f"there are recordings in its subfolders {_listed(inside)}: name one of them"
    if not entries:
        return "the folder is empty"
    return f"it contains {_listed([entry.name for entry in entries])}"


def _listed(names: list[str], limit: int = 5) -> str:
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(repr(name) for name in names[:limit]) + more


def fingerprint(path: Path) -> dict[str, Any]:
    """Returns the identity of a recording in any folder: sizes and a hash of the ends of its files.

    It is ready for JSON. `metadata.yaml` does not count.

    Raises:
        OSError: A file cannot be read.
    """
    files, ends = stored_files(path), []
    for file in files:
        with file.open("rb") as stream:
            stream.seek(max(0, file.stat().st_size - _END_BYTES))
            ends.append(hashlib.sha256(stream.read()).hexdigest())
    return {
        "num_files": len(files),
        "num_bytes": sum(file.stat().st_size for file in files),
        "hash": hashlib.sha256("".join(sorted(ends)).encode()).hexdigest()[:16],
    }


@dataclass(frozen=True)
class Metadata:
    """Files and message counts listed in metadata.yaml."""

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
    with file.open("rb") as stream:
        data = stream.read(_METADATA_BYTES + 1)
    if len(data) > _METADATA_BYTES:
        raise ValueError(f"it has more than {_METADATA_BYTES} bytes")
    try:
        # Without types: a crafted number in base 60 takes a minute.
        content = YAML(typ="base").load(data.decode())[_ROOT]
    except YAMLError as error:
        problem = getattr(error, "problem", None) or type(error).__name__
        raise ValueError(f"YAML error: {problem}") from error
    counts: Counter[str] = Counter()
    for topic in content["topics_with_message_count"]:
        count = int(_typed(topic["message_count"], str))
        if not 0 <= count < _MOST:
            raise ValueError("a message_count is out of range")
        counts[_typed(topic["topic_metadata"]["name"], str)] += count
    # Whatever folders a path names, only this one is looked into, and once for each file.
    names = [PurePath(_typed(path, str)).name for path in content["relative_file_paths"]]
    return Metadata([folder / name for name in dict.fromkeys(names)], counts)


def _typed(value: Any, kind: type[Kind]) -> Kind:  # noqa: ANN401 - of YAML
    if not isinstance(value, kind):
        raise TypeError(f"found a {type(value).__name__}, expected a {kind.__name__}")
    return value


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
