# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The metadata.yaml of a rosbag2 folder: checked before it is used, and written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, ScalarEvent

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_files import METADATA_NAME

# One of 5,000 files; to parse it takes 10 s, and it is parsed twice.
_MAX_BYTES: Final = 2**20
# Of what it holds if each alias is replaced by what it stands for; 5,000 files have 80,000 values.
_MAX_VALUES: Final = 2**18
_MAX_DEPTH: Final = 50
_MERGE: Final = "<<"
_MERGE_TAG: Final = "tag:yaml.org,2002:merge"
_ROOT: Final = "rosbag2_bagfile_information"
_NONE: Final = type(None)
_NAMES: Final = {str: "a text", int: "an integer", list: "a list", dict: "a table", _NONE: "null"}
_OPTIONAL: Final = "?"
_MAX_INTEGER: Final = 2**63 - 1

# What rosbags uses: key -> type, schema of a table, or [schema of each entry]; `?` at the end of a
# key: may be absent. Types in a tuple are alternatives. Other keys may hold anything.
_TIMES: Final = {
    "starting_time": {"nanoseconds_since_epoch": int},
    "duration": {"nanoseconds": int},
    "message_count": int,
}
_SCHEMA: Final = {
    _ROOT: {
        **_TIMES,
        "version": int,
        "storage_identifier": str,
        "relative_file_paths": [str],
        "compression_format?": (str, _NONE),
        "compression_mode?": str,
        "topics_with_message_count": [
            {
                "message_count": int,
                "topic_metadata": {
                    "name": str,
                    "type": str,
                    "serialization_format": str,
                    "offered_qos_profiles?": (str, list, _NONE),
                    "type_description_hash?": (str, _NONE),
                },
            }
        ],
        "files?": list,
    }
}


@dataclass(frozen=True)
class Metadata:
    """What the metadata.yaml of a folder promises: its files, and the messages of each topic."""

    files: tuple[Path, ...]
    counts: Counter[str]


def read_metadata(folder: Path) -> Metadata | None:
    """Reads and checks the metadata.yaml of a folder; None if it has none.

    Raises:
        RecordingError: It cannot be read, or a value is missing, of the wrong type or out of range;
            the text names the key.
    """
    file = folder / METADATA_NAME
    if not file.is_file():
        return None
    try:
        if file.stat().st_size > _MAX_BYTES:
            raise ValueError(f"it is larger than {_MAX_BYTES} bytes")
        text = file.read_text("utf-8")
        _check_expansion(text)
        document = YAML(typ="safe").load(text)
        _check(document, _SCHEMA, "")
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = "" if mark is None else f" in line {mark.line + 1}"
        text = getattr(error, "problem", None) or type(error).__name__
        raise RecordingError(f"{file}: cannot be read: YAML error{where}: {text}") from error
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, TypeError, RecursionError) as error:
        text = " ".join(str(error).split())
        raise RecordingError(f"{file}: cannot be read: {text}") from error
    content = document[_ROOT]
    counts: Counter[str] = Counter()
    for topic in content["topics_with_message_count"]:
        counts[topic["topic_metadata"]["name"]] += topic["message_count"]
    # Whatever folders a path names, only this one is looked into, by rosbags, too.
    files = (folder / PurePath(name).name for name in content["relative_file_paths"])
    return Metadata(tuple(files), counts)


def _check_expansion(text: str) -> None:
    """Refuses what grows when it is read; merge keys double the work with each line."""
    sizes: dict[str | None, int] = {}
    unfinished: list[tuple[str | None, int]] = []
    number = 0
    for event in YAML(typ="safe").parse(text):
        if isinstance(event, AliasEvent):
            number += sizes.get(event.anchor, 0)
        elif isinstance(event, CollectionEndEvent):
            anchor, before = unfinished.pop()
            sizes[anchor] = number - before
        elif isinstance(event, CollectionStartEvent):
            unfinished.append((event.anchor, number))
            # An alias within what it stands for has no end.
            sizes[event.anchor] = _MAX_VALUES
            number += 1
        elif isinstance(event, ScalarEvent):
            if event.value == _MERGE or event.tag == _MERGE_TAG:
                line = event.start_mark.line + 1
                raise ValueError(f"line {line} has the merge key '<<', which is not supported")
            sizes[event.anchor] = 1
            number += 1
        if number > _MAX_VALUES:
            raise ValueError(f"with its aliases it has more than {_MAX_VALUES} values")
        if len(unfinished) > _MAX_DEPTH:
            raise ValueError(f"it is nested more than {_MAX_DEPTH} levels deep")


def _check(value: object, schema: object, key: str) -> None:
    if isinstance(schema, dict):
        table = _of_type(value, (dict,), key)
        for name, part in schema.items():
            required = name.removesuffix(_OPTIONAL)
            place = f"{key}.{required}" if key else required
            if required in table:
                _check(table[required], part, place)
            elif name == required:
                raise ValueError(f"key {place!r} is missing")
    elif isinstance(schema, list):
        for number, entry in enumerate(_of_type(value, (list,), key)):
            _check(entry, schema[0], f"{key}[{number}]")
    else:
        _of_type(value, schema if isinstance(schema, tuple) else (schema,), key)


def _of_type(value: object, types: tuple[Any, ...], key: str) -> Any:  # noqa: ANN401
    where = f"key {key!r}" if key else "the document"
    # In Python, True is an integer, too.
    if isinstance(value, types) and not isinstance(value, bool):
        if isinstance(value, int) and not 0 <= value <= _MAX_INTEGER:
            # Python refuses to write out an integer of thousands of digits.
            raise ValueError(f"{where} is out of range, expected 0 to {_MAX_INTEGER}")
        return value
    expected = " or ".join(_NAMES[one] for one in types)
    raise ValueError(f"{where} is of type {type(value).__name__}, expected {expected}")


@dataclass
class WrittenTopic:
    """A topic of a recording that is being written: its channel in the mcap file, and so on."""

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
