# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reading recordings of any ROS version: rosbag2 (mcap, sqlite3) and ROS 1 bags."""

import copy
import math
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from mnsf_ros.errors import UNREADABLE, RecordingError
from mnsf_ros.recording.bag_files import (
    COMPRESSED,
    MCAP,
    METADATA_NAME,
    ROS1,
    read_metadata,
    recording_files,
    stored_files,
)
from mnsf_ros.recording.bag_topics import (
    CDR,
    TopicSummary,
    add_topic,
    jazzy,
    known_topic,
    listing,
)
from mnsf_ros.recording.mcap_file import McapFile
from mnsf_ros.recording.ros1_file import Ros1File
from mnsf_ros.recording.sqlite_file import SqliteFile
from mnsf_ros.recording.storage_file import Converted, Damage, Readable, StorageFile
from msg_utils.expansion import expand_file, expanded
from msg_utils.other_clouds import UnsupportedCloudError, as_cloud

_MAX_WARNINGS: Final = 5
# Beginning of each zstd frame. A ROS 2 message begins with a zero byte, so that compressed ones are
# recognized without metadata.yaml.
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


class BagReader:
    """An open recording; use it as a context manager.

    Messages come in the order of the files, each file in the order of recording. This may differ
    from the order of their header stamps, which are the times of measurement.

    Attributes:
        path: The folder or file that was given.
        topics: Topic name to its type and number of messages.
        damages: Damage found on opening; `readable_messages` finds the rest.
        has_checksums: Whether flipped bits in messages are noticed.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.topics: dict[str, TopicSummary] = {}
        self.damages: tuple[Damage, ...] = ()
        self.has_checksums = False
        self._start_ns = -math.inf
        self._files: list[StorageFile] = []
        self._stack = ExitStack()

    def __enter__(self) -> "BagReader":
        """Opens the recording.

        Raises:
            RecordingError: It is missing, empty, not a recording, or unreadable.
        """
        with ExitStack() as stack:
            paths, promised, damages = _listed(self.path)
            self._files, unreadable = _opened(paths, stack)
            damages += [*unreadable, *chain(*(one.damages for one in self._files))]
            if not self._files:
                raise damages[0].error()
            topics: dict[str, TopicSummary] = {}
            for name, summary in chain(*(one.topics.items() for one in self._files)):
                add_topic(topics, name, summary)
            self.topics = dict(sorted(topics.items()))
            counts = {topic: summary.count for topic, summary in self.topics.items()}
            if not any(one.count for one in topics.values() if one.encoding == CDR):
                causes = [f"{self.path}: holds no messages", *map(str, damages[:1])]
                if any(counts.values()):
                    causes.append(f"expected CDR of ROS 2, {listing(self.topics)}")
                raise RecordingError("; ".join(causes))
            promised = Counter(counts) if promised is None else promised
            for topic in sorted({*promised, *counts}):
                if (number := promised[topic]) != (stored := counts.get(topic, 0)):
                    text = f"promises {number} messages on {topic!r}, {stored} are stored"
                    damages.append(Damage(str(self.path / METADATA_NAME), "", text))
            self.damages = tuple(damages)
            self.has_checksums = all(one.has_checksums for one in self._files)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the recording."""
        self._files = []
        self._stack.close()

    @property
    def span_ns(self) -> tuple[int, int]:
        """Receive times of the first and of the last message in nanoseconds."""
        files = [one for one in self._files if one.first_ns < float("inf")]
        first_ns = min((one.first_ns for one in files), default=0)
        return int(first_ns), int(max((one.last_ns for one in files), default=first_ns))

    def since(self, start_ns: int) -> "BagReader":
        """Returns the open recording without messages that were received before a time."""
        later = copy.copy(self)
        later._start_ns = start_ns
        return later

    def messages(self, topic: str) -> Iterator[Any]:
        """Returns the messages of a topic, deserialized, with the attributes of the ROS type.

        Clouds of all `CLOUD_TYPES` are PointCloud2. Arrays in messages are read-only.

        Raises:
            RecordingError: The topic is unknown (at once), or damage is met that is not in
                `damages`.
        """
        return (message for _, message in self._undamaged(self.readable_messages(topic)))

    def raw_messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Returns receive time in nanoseconds and CDR bytes of each message, see `messages`."""
        known_topic(self.path, self.topics, topic)
        return self._undamaged(self._converted(topic, _expanded))

    def readable_messages(self, topic: str) -> Iterator[Readable[Any]]:
        """Returns receive time in nanoseconds and message, or a Damage where some may be missing.

        Raises:
            RecordingError: The topic is unknown (at once), or has clouds that are not supported.
        """
        msgtype = known_topic(self.path, self.topics, topic).msgtype

        def message(raw: bytes) -> Any:  # noqa: ANN401 - rosbags makes its class
            return as_cloud(jazzy().deserialize_cdr(_expanded(raw), msgtype))

        return self._converted(topic, message)

    def _undamaged(self, found: Iterator[Readable[Converted]]) -> Iterator[tuple[int, Converted]]:
        for item in found:
            if not isinstance(item, Damage):
                yield item
            elif item not in self.damages:
                raise item.error()

    def _converted(
        self, topic: str, convert: Callable[[bytes], Converted]
    ) -> Iterator[Readable[Converted]]:
        number, is_damaged = 0, False
        for item in chain.from_iterable(self._stored(one, topic) for one in self._files):
            if isinstance(item, Damage):
                is_damaged = True
                yield item
                continue
            number += 1
            received_ns, raw = item
            try:
                converted = convert(raw)
            except UnsupportedCloudError as error:
                raise RecordingError(f"{self.path}: topic {topic!r}: {error}") from error
            except UNREADABLE as error:
                text = f"message {number} on {topic!r} cannot be read"
                yield Damage.of(self.path, "", error, text)
            else:
                yield received_ns, converted
        expected = self.topics[topic].count
        if self._start_ns == -math.inf and number != expected and not is_damaged:
            text = f"{number} of {expected} messages on {topic!r} were found"
            yield Damage(str(self.path), "", text)

    def _stored(self, file: StorageFile, topic: str) -> Iterator[Readable[bytes]]:
        count = 0
        try:
            for item in file.messages(topic, self._start_ns):
                yield item
                count += 1
        except UNREADABLE as error:
            text = f"damaged after {count} messages on {topic!r}"
            yield Damage.of(file.path, "", error, text)


@contextmanager
def open_recording(path: Path | str, warn: Callable[[str], None]) -> Iterator[BagReader]:
    """Opens a recording as `BagReader`, and warns of its damage in a few lines."""
    with BagReader(path) as reader:
        for damage in reader.damages[:_MAX_WARNINGS]:
            warn(str(damage))
        if (more := len(reader.damages) - _MAX_WARNINGS) > 0:
            warn(f"{path}: and {more} more")
        yield reader


def _listed(path: Path) -> tuple[list[Path], Counter[str] | None, list[Damage]]:
    """Files, promised counts of messages, if any, and the damage of metadata.yaml."""
    metadata = path / METADATA_NAME
    if not metadata.is_file():
        return recording_files(path), None, []
    try:
        files, promised = read_metadata(path)
    except UNREADABLE as error:
        return recording_files(path), None, [Damage.of(metadata, "", error, "cannot be read")]
    others = [file.name for file in stored_files(path) if file not in files]
    if others and not any(map(Path.is_file, files)):
        text = "names none of the files that are there; all of these are read"
        return recording_files(path), promised, [Damage(str(metadata), "", text)]
    text = "does not name this file, which is not read; name it, or remove metadata.yaml"
    return files, promised, [Damage(str(metadata), name, text) for name in others]


def _opened(paths: list[Path], stack: ExitStack) -> tuple[list[StorageFile], list[Damage]]:
    """Readable files in the order of time, and the damage of the others."""
    files: list[StorageFile] = []
    damages = []
    for path in paths:
        try:
            files.append(_storage(path, stack))
        except UNREADABLE as error:
            damages.append(Damage.of(path, "", error, "cannot be read"))
    return sorted(files, key=lambda one: one.first_ns), damages


def _storage(path: Path, stack: ExitStack) -> StorageFile:
    # To open a named pipe would take for ever.
    if path.exists() and not path.is_file():
        raise OSError(f"{path.name!r} is not a regular file")
    if path.suffix == COMPRESSED:
        plain = Path(stack.enter_context(TemporaryDirectory()), path.stem)
        expand_file(path, plain)
        path = plain
    if path.suffix == MCAP:
        return McapFile(path)
    return Ros1File(path) if path.suffix == ROS1 else SqliteFile(path)


def _expanded(raw: bytes) -> bytes:
    """Returns a ROS 2 message, decompressed if it was compressed by itself."""
    return expanded(raw, "zstd") if raw.startswith(_ZSTD_MAGIC) else raw
