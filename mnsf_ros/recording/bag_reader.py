"""Reading recordings of any ROS version: rosbag2 (mcap, sqlite3) and ROS 1 bags."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_errors import UNREADABLE, reason
from mnsf_ros.recording.bag_files import recording_files
from mnsf_ros.recording.bag_topics import (
    TopicSummary,
    find_topic,
    known_topic,
    shares_position,
    summarize,
)
from mnsf_ros.recording.message_compression import decompressed
from mnsf_ros.recording.ros1_messages import cdr_from_ros1

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

    from rosbags.interfaces import Connection

Converted = TypeVar("Converted")


class BagReader:
    """An open recording; use it as a context manager, from one thread.

    Messages come in the order they were received when recording. That is not always the order
    of their header stamps, and the receive time is no measurement time: go by header stamps.

    Attributes:
        path: The folder or file that was given.
        topics: Topic name -> what it holds.
    """

    def __init__(self, path: Path | str) -> None:
        """Name the recording; nothing is opened before `with`."""
        self.path = Path(path)
        self.topics: dict[str, TopicSummary] = {}
        self._source: AnyReader | None = None

    def __enter__(self) -> BagReader:
        """Open the recording.

        Raises:
            RecordingError: It is missing, damaged, empty or not a recording at all.
        """
        self._source = self._open_source()
        try:
            self.topics = summarize(self.path, self._source)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the recording."""
        self.close()

    def close(self) -> None:
        """Close the recording; closing twice does nothing."""
        source, self._source = self._source, None
        if source is not None:
            source.close()

    def find_topic(self, name: str | None, msgtype: str) -> str:
        """Return `name` if it has messages of this type, or if None the only topic that has.

        Raises:
            RecordingError: There is no such topic, it is of another type or empty, or there are
                several to choose from.
        """
        return find_topic(self.path, self.topics, name, msgtype)

    def messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Any]:
        """Return the messages of a topic, deserialized, with the attributes of the ROS type.

        Arrays in them are read-only. The arguments and errors are those of `raw_messages`.
        """
        received = self.received_messages(topic, start_ns=start_ns, stop_ns=stop_ns)
        return (message for _, message in received)

    def received_messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Return receive time in nanoseconds and message of each message, see `messages`."""

        def deserialized(source: AnyReader, raw: bytes, msgtype: str) -> Any:  # noqa: ANN401
            return source.deserialize(raw, msgtype)

        known_topic(self.path, self.topics, topic)
        return self._converted(topic, start_ns, stop_ns, deserialized)

    def raw_messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[int, bytes]]:
        """Return the messages of a topic as they go over the wire in ROS 2.

        Args:
            topic: One of `topics`.
            start_ns: Receive time to begin with, in nanoseconds; None for the first message.
            stop_ns: Receive time to end before; None for the last message included.

        Returns:
            Receive time in nanoseconds and CDR bytes of each message.

        Raises:
            RecordingError: The topic is unknown (at once), or damage is met on the way.
        """

        def serialized(source: AnyReader, raw: bytes, msgtype: str) -> bytes:
            return raw if source.is2 else cdr_from_ros1(raw, msgtype, source.typestore)

        known_topic(self.path, self.topics, topic)
        return self._converted(topic, start_ns, stop_ns, serialized)

    def _converted(
        self,
        topic: str,
        start_ns: int | None,
        stop_ns: int | None,
        convert: Callable[[AnyReader, bytes, str], Converted],
    ) -> Iterator[tuple[int, Converted]]:
        scan = self._scan(topic, start_ns, stop_ns)
        for number, (source, connection, received_ns, stored) in enumerate(scan):
            try:
                # Without its metadata.yaml, rosbags gives out a message compressed as it is.
                raw = decompressed(stored) if source.is2 else stored
                converted = convert(source, raw, connection.msgtype)
            except UNREADABLE as error:
                raise self._damage(number, topic, error) from error
            yield received_ns, converted

    def _scan(
        self, topic: str, start_ns: int | None, stop_ns: int | None
    ) -> Iterator[tuple[AnyReader, Connection, int, bytes]]:
        """Yield source, connection, receive time and bytes; only calls into rosbags are guarded."""
        number = 0
        with self._source_of_scan() as source:
            connections = [c for c in source.connections if c.topic == topic]
            scan = source.messages(connections, start_ns, stop_ns)
            while True:
                try:
                    found = next(scan, None)
                except UNREADABLE as error:
                    raise self._damage(number, topic, error) from error
                if found is None:
                    break
                yield (source, *found)
                number += 1
        expected = self.topics[topic].count
        if start_ns is None and stop_ns is None and number != expected:
            raise RecordingError(
                f"{self.path}: {number} of {expected} messages on {topic!r} could be read: its "
                "index or metadata.yaml does not fit its content"
            )

    @contextmanager
    def _source_of_scan(self) -> Iterator[AnyReader]:
        if self._source is None:
            raise RecordingError(f"{self.path}: is not open")
        if not shares_position(self._source):
            yield self._source
            return
        source = self._open_source()
        try:
            yield source
        finally:
            source.close()

    def _open_source(self) -> AnyReader:
        files = recording_files(self.path)
        try:
            self._check_no_pipes(files)
            # Bags of older ROS versions come without type definitions: then these are used.
            source = AnyReader(files, default_typestore=get_typestore(Stores.ROS2_JAZZY))
            source.open()
        except UNREADABLE as error:
            raise RecordingError(f"{self.path}: cannot be read: {reason(error)}") from error
        return source

    def _check_no_pipes(self, files: list[Path]) -> None:
        """Refuse what would keep an open waiting for ever, such as a named pipe."""
        for file in files:
            for entry in file.iterdir() if file.is_dir() else [file]:
                if entry.exists() and not (entry.is_file() or entry.is_dir()):
                    raise RecordingError(f"{self.path}: {entry.name!r} is not a regular file")

    def _damage(self, number: int, topic: str, error: Exception) -> RecordingError:
        return RecordingError(
            f"{self.path}: damaged after {number} good messages on {topic!r}: {reason(error)}"
        )
