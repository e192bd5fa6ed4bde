"""Reading storage files from front to end, around whatever is damaged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosbags.typesys import Stores, get_typestore

from mnsf_ros.recording.bag_errors import UNREADABLE, reason
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TopicSummary, known_topic
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.stored_messages import ENCODINGS, as_cdr, stored_messages

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from mnsf_ros.recording.mcap_messages import StoredMessage


class SequentialReader(BagReader):
    """A reader that needs no index, verifies checksums and goes on after damage.

    Messages come in the order of the files. Any number of scans may be under way at a time.
    """

    def __init__(
        self, path: Path | str, files: Sequence[Path], topics: Mapping[str, TopicSummary]
    ) -> None:
        """Names the recording.

        Args:
            path: The recording, for error texts.
            files: Its mcap files in the order of time, or one ROS 1 bag.
            topics: What is in them, see `inspect_recording`.
        """
        super().__init__(path)
        self._files = tuple(files)
        self._known_topics = dict(topics)
        self._typestore = get_typestore(Stores.ROS2_JAZZY)

    def __enter__(self) -> SequentialReader:
        """Opens the recording; the files themselves are opened by each scan."""
        self.topics = dict(self._known_topics)
        return self

    def messages_and_damages(self, topic: str) -> Iterator[tuple[int, Any] | Damage]:
        """Yields receive time and message, and a Damage wherever messages may be missing.

        Raises:
            RecordingError: The topic is unknown.
        """
        known_topic(self.path, self.topics, topic)
        for message in self._stored(topic):
            if isinstance(message, Damage):
                yield message
                continue
            try:
                content = self._typestore.deserialize_cdr(message.raw, message.channel.msgtype)
            except UNREADABLE as error:
                text = f"damaged message on {topic!r}: {reason(error)}"
                yield Damage(str(self.path), f"byte {message.offset}", text)
                continue
            yield message.received_ns, content

    def received_messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Returns what can be read, in the order of the file, see `BagReader`."""
        known_topic(self.path, self.topics, topic)
        return (
            item
            for item in self.messages_and_damages(topic)
            if not isinstance(item, Damage) and _is_within(item[0], start_ns, stop_ns)
        )

    def raw_messages(
        self, topic: str, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[int, bytes]]:
        """Returns what can be read, in the order of the file, see `BagReader`."""
        known_topic(self.path, self.topics, topic)
        return (
            (message.received_ns, message.raw)
            for message in self._stored(topic)
            if not isinstance(message, Damage)
            and _is_within(message.received_ns, start_ns, stop_ns)
        )

    def _stored(self, topic: str) -> Iterator[StoredMessage | Damage]:
        for file in self._files:
            yield from _messages_of_file(file, topic)


def _messages_of_file(file: Path, topic: str) -> Iterator[StoredMessage | Damage]:
    try:
        for message in stored_messages(file):
            if isinstance(message, Damage):
                yield message
            elif _is_wanted(message, topic):
                yield _with_cdr(file, message)
    except OSError as error:
        yield Damage(str(file), "", f"cannot be read: {reason(error)}")


def _with_cdr(file: Path, message: StoredMessage) -> StoredMessage | Damage:
    try:
        return message._replace(raw=as_cdr(message))
    except UNREADABLE as error:
        text = f"damaged message on {message.channel.topic!r}: {reason(error)}"
        return Damage(str(file), f"byte {message.offset}", text)


def _is_wanted(message: StoredMessage, topic: str) -> bool:
    return message.channel.topic == topic and message.channel.encoding in ENCODINGS


def _is_within(received_ns: int, start_ns: int | None, stop_ns: int | None) -> bool:
    after_start = start_ns is None or received_ns >= start_ns
    return after_start and (stop_ns is None or received_ns < stop_ns)
