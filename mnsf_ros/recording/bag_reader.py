# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reading recordings of any ROS version: rosbag2 (mcap, sqlite3) and ROS 1 bags."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag1, QosDurability
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.reader import Reader as Ros2Reader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.decompression import FileBudget, decompress
from mnsf_ros.errors import NoIndexError, RecordingError
from mnsf_ros.recording.bag_files import METADATA_NAME, recording_files
from mnsf_ros.recording.bag_topics import TopicSummary, find_topic, known_topic
from mnsf_ros.recording.damage import UNREADABLE, Damage, reason, unfit_counts, unfit_database
from mnsf_ros.recording.metadata import read_metadata
from mnsf_ros.recording.ros1_chunks import keep_last_chunks
from mnsf_ros.recording.ros1_messages import cdr_from_ros1
from mnsf_ros.recording.rosbags_limits import limit_rosbags, next_within

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Converted = TypeVar("Converted")
# A message with its receive time in nanoseconds, or why some may be missing.
Readable: TypeAlias = "tuple[int, Converted] | Damage"

limit_rosbags()
# What every zstd frame begins with. A ROS 2 message begins with a zero byte, so the bytes tell
# for themselves, also in a file that has lost the metadata.yaml which says so.
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class StoredMessage(NamedTuple):
    """A message as it is stored.

    Attributes:
        topic: Name of the topic.
        msgtype: For example `sensor_msgs/msg/PointCloud2`, empty if unknown.
        received_ns: Receive time in nanoseconds.
        raw: The serialized message.
        file: The file or folder that it is in.
        offset: Where its record, or that of its chunk, begins in the file; None if unknown.
        is_verified: Whether a checksum says that it is what was written.
        is_latched: Whether its topic is, see `TopicSummary`; only salvaged messages say so.
    """

    topic: str
    msgtype: str
    received_ns: int
    raw: bytes
    file: Path
    offset: int | None = None
    is_verified: bool = False
    is_latched: bool = False


class BagReader:
    """An open recording; use it as a context manager, from one thread.

    Messages come in the order they were received when recording. That is not always the order
    of their header stamps, and the receive time is no measurement time: go by header stamps.

    Each scan may expand to as much as a `FileBudget` of all files allows, and ends there.

    Attributes:
        path: The folder or file that was given.
        topics: Topic name -> what it holds.
    """

    def __init__(self, path: Path | str) -> None:
        """Names the recording; nothing is opened before `with`."""
        self.path = Path(path)
        self.topics: dict[str, TopicSummary] = {}
        self._source: AnyReader | None = None
        self._are_compressed = False

    def __enter__(self) -> BagReader:
        """Opens the recording.

        Raises:
            NoIndexError: It may be whole, but cannot be read by an index.
            RecordingError: It is missing, damaged, empty or not a recording at all.
        """
        self._source = self._open_source()
        try:
            self.topics = _summaries(self.path, self._source)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the recording."""
        self.close()

    def close(self) -> None:
        """Closes the recording; closing twice does nothing."""
        source, self._source = self._source, None
        if source is not None:
            source.close()

    def find_topic(self, name: str | None, msgtype: str) -> str:
        """Returns `name` if it has messages of this type, or if None the only topic that has.

        Raises:
            RecordingError: There is no such topic, it is of another type or empty, or there are
                several to choose from.
        """
        return find_topic(self.path, self.topics, name, msgtype)

    def contradictions(self) -> tuple[Damage, ...]:
        """Returns where the files do not fit metadata.yaml, or a database its own indexes."""
        source = self._opened()
        promised: Counter[str] = Counter()
        for connection in source.connections:
            promised[connection.topic] += connection.msgcount
        found = {topic: summary.count for topic, summary in self.topics.items()}
        damages = list(unfit_counts(self.path / METADATA_NAME, promised, found))
        for storage in _storages(source):
            if isinstance(storage, Sqlite3Reader) and storage.dbconn is not None:
                damages += unfit_database(str(storage.path), storage.dbconn)
        return tuple(damages)

    def messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Any]:
        """Returns the messages of a topic, deserialized, with the attributes of the ROS type.

        Arrays in them are read-only. The arguments and errors are those of `raw_messages`.
        """
        received = self.received_messages(topic, start_ns=start_ns, stop_ns=stop_ns)
        return (message for _, message in received)

    def received_messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Returns receive time in nanoseconds and message of each message, see `messages`."""
        known_topic(self.path, self.topics, topic)
        return self._whole(self._converted(topic, start_ns, stop_ns, self._deserialized))

    def raw_messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[int, bytes]]:
        """Returns receive time in nanoseconds and CDR bytes of each message of a topic.

        Only those are returned that were received from `start_ns` on and before `stop_ns`.

        Raises:
            RecordingError: The topic is unknown (at once), or damage is met on the way.
        """
        known_topic(self.path, self.topics, topic)
        return self._whole(self._converted(topic, start_ns, stop_ns, self._serialized))

    def readable_messages(self, topic: str) -> Iterator[Readable[Any]]:
        """Returns receive time in nanoseconds and message of all messages that can be read.

        Wherever some may be missing there is a Damage.

        Raises:
            RecordingError: The topic is unknown.
        """
        known_topic(self.path, self.topics, topic)
        return self._converted(topic, None, None, self._deserialized)

    def _whole(self, found: Iterator[Readable[Converted]]) -> Iterator[tuple[int, Converted]]:
        for item in found:
            if isinstance(item, Damage):
                raise RecordingError(str(item))
            yield item

    def _converted(
        self,
        topic: str,
        start_ns: int | None,
        stop_ns: int | None,
        convert: Callable[[bytes, str, FileBudget], Converted],
    ) -> Iterator[Readable[Converted]]:
        number = 0
        budget = FileBudget(sum(map(_num_bytes, self._opened_files())), "the recording")
        for item in self._stored(topic, start_ns, stop_ns, budget):
            if isinstance(item, Damage):
                yield item
                continue
            try:
                converted = convert(item.raw, item.msgtype, budget)
            except UNREADABLE as error:
                where = "" if item.offset is None else f"byte {item.offset}"
                yield _damage(item.file, where, number, topic, error)
                if budget.is_spent:
                    return
            else:
                yield item.received_ns, converted
                number += 1

    def _stored(
        self, topic: str, start_ns: int | None, stop_ns: int | None, budget: FileBudget
    ) -> Iterator[StoredMessage | Damage]:
        """Yields what is stored; only calls into rosbags are guarded."""
        number = 0
        source = self._opened()
        connections = [c for c in source.connections if c.topic == topic]
        scan = source.messages(connections, start_ns, stop_ns)
        while True:
            try:
                found = next_within(budget, scan)
            except UNREADABLE as error:
                yield _damage(self.path, "", number, topic, error)
                return
            if found is None:
                break
            connection, received_ns, raw = found
            yield StoredMessage(topic, connection.msgtype, received_ns, raw, self.path)
            number += 1
        expected = self.topics[topic].count
        if start_ns is None and stop_ns is None and number != expected:
            text = (
                f"{number} of {expected} messages on {topic!r} could be read: its index or "
                "metadata.yaml does not fit its content"
            )
            yield Damage(str(self.path), "", text)

    def _deserialized(self, raw: bytes, msgtype: str, budget: FileBudget) -> Any:  # noqa: ANN401
        source = self._opened()
        return source.deserialize(self._decompressed(raw, budget) if source.is2 else raw, msgtype)

    def _serialized(self, raw: bytes, msgtype: str, budget: FileBudget) -> bytes:
        source = self._opened()
        if source.is2:
            return self._decompressed(raw, budget)
        return cdr_from_ros1(raw, msgtype, source.typestore)

    def _decompressed(self, raw: bytes, budget: FileBudget) -> bytes:
        if self._are_compressed:
            return decompress("zstd", raw, budget=budget)
        return decompressed(raw, budget)

    def _opened_files(self) -> Sequence[Path]:
        """The files that are read; of compressed ones their decompressed copies."""
        return [storage.path for storage in _storages(self._opened())]

    def _opened(self) -> AnyReader:
        if self._source is None:
            raise RecordingError(f"{self.path}: is not open")
        return self._source

    def _open_source(self) -> AnyReader:
        files = recording_files(self.path)
        if files == [self.path] and self.path.is_dir():
            read_metadata(self.path)
        try:
            # Bags of older ROS versions come without type definitions: then these are used.
            source = AnyReader(files, default_typestore=get_typestore(Stores.ROS2_JAZZY))
            source.open()
        except NoIndexError as error:
            raise NoIndexError(f"{self.path}: cannot be read: {error}") from error
        except UNREADABLE as error:
            raise RecordingError(f"{self.path}: cannot be read: {reason(error)}") from error
        for reader in source.readers:
            if isinstance(reader, Ros1Reader):
                keep_last_chunks(reader)
                continue
            storage = reader.storage
            if isinstance(storage, DirectoryReader):
                self._are_compressed = storage.metadata.compression_mode == "message"
                # Messages come as they are stored: rosbags gives up after the first damaged one.
                storage.metadata = storage.metadata._replace(compression_mode=None)
                # rosbags reads the files as metadata.yaml lists them.
                storage.storages.sort(key=lambda file: file.metadata.start_time)
        return source


def _num_bytes(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _damage(file: Path, where: str, number: int, topic: str, error: Exception) -> Damage:
    text = f"damaged after {number} good messages on {topic!r}: {reason(error)}"
    return Damage(str(file), where, text)


def decompressed(raw: bytes, budget: FileBudget) -> bytes:
    """Returns a ROS 2 message as it was before it was compressed by itself, if it was.

    Raises:
        DecompressionError: It is damaged, or expands to more than any cloud has, or than is left
            of the budget.
    """
    if raw[: len(_ZSTD_MAGIC)] != _ZSTD_MAGIC:
        return raw
    return decompress("zstd", raw, budget=budget)


def _summaries(path: Path, source: AnyReader) -> dict[str, TopicSummary]:
    """Returns topic name -> summary of an open recording, sorted by name.

    The counts are those of the storage files: a metadata.yaml may promise something else.
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
    latched = {connection.topic for connection in source.connections if _is_latched(connection)}
    return {
        topic: TopicSummary(" and ".join(sorted(types[topic])), counts[topic], topic in latched)
        for topic in sorted(types)
    }


def _is_latched(connection: Connection) -> bool:
    extension = connection.ext
    if isinstance(extension, ConnectionExtRosbag1):
        return bool(extension.latching)
    return any(
        profile.durability is QosDurability.TRANSIENT_LOCAL
        for profile in extension.offered_qos_profiles
    )


def _storages(source: AnyReader) -> list[Any]:
    """Returns the readers of the single files."""
    storages: list[Any] = []
    for reader in source.readers:
        storage = reader.storage if isinstance(reader, Ros2Reader) else reader
        storages += storage.storages if isinstance(storage, DirectoryReader) else [storage]
    return storages
