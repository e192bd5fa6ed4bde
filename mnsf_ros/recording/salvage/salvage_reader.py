"""Reading storage files from front to end, around whatever is damaged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rosbags.typesys import Stores, get_typestore

from mnsf_ros.recording.bag_files import ROS1
from mnsf_ros.recording.bag_reader import (
    BagReader,
    Converted,
    Readable,
    StoredMessage,
    decompressed,
)
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import UNREADABLE, Damage, reason
from mnsf_ros.recording.ros1_messages import cdr_from_ros1
from mnsf_ros.recording.salvage.mcap_messages import (
    SalvagedMessage,
    Summary,
    read_messages,
    read_summary,
)
from mnsf_ros.recording.salvage.ros1_records import ROS1_ENCODING, read_ros1_messages

# How messages are serialized that can be read.
ENCODINGS: Final = frozenset({"cdr", ROS1_ENCODING})


def salvaged_messages(file: Path) -> tuple[Summary, Iterator[SalvagedMessage | Damage]]:
    """Returns what the index of a file says, and all messages, or a Damage, in its order.

    Args:
        file: An mcap file or a ROS 1 bag. The iterator raises an OSError if it cannot be read.
    """
    if file.suffix == ROS1:
        return Summary(), read_ros1_messages(file)
    summary = read_summary(file)
    return summary, read_messages(file, summary)


class SalvageReader(BagReader):
    """A reader that needs no index, verifies checksums and goes on after damage.

    Messages come in the order of the files. Any number of scans may be under way at a time.
    What is damaged is left out; only `readable_messages` tells where.
    """

    def __init__(
        self, path: Path | str, files: Sequence[Path], topics: Mapping[str, TopicSummary]
    ) -> None:
        """Names the recording.

        Args:
            path: The recording, for error texts.
            files: Its mcap files in the order of time, or ROS 1 bags.
            topics: What is in them, see `inspect_recording`.
        """
        super().__init__(path)
        self._files = tuple(files)
        self._known_topics = dict(topics)
        self._typestore = get_typestore(Stores.ROS2_JAZZY)

    def __enter__(self) -> SalvageReader:
        """Opens the recording; the files themselves are opened by each scan."""
        self.topics = dict(self._known_topics)
        return self

    def _whole(self, found: Iterator[Readable[Converted]]) -> Iterator[tuple[int, Converted]]:
        return (item for item in found if not isinstance(item, Damage))

    def _deserialized(self, raw: bytes, msgtype: str) -> Any:  # noqa: ANN401
        return self._typestore.deserialize_cdr(raw, msgtype)

    def _serialized(self, raw: bytes, _msgtype: str) -> bytes:
        return raw

    def _stored(
        self, topic: str, start_ns: int | None, stop_ns: int | None
    ) -> Iterator[StoredMessage | Damage]:
        for file in self._files:
            try:
                _, messages = salvaged_messages(file)
                for message in messages:
                    if isinstance(message, Damage):
                        yield message
                    elif _is_wanted(message, topic, start_ns, stop_ns):
                        yield self._as_cdr(file, message)
            except OSError as error:
                yield Damage(str(file), "", f"cannot be read: {reason(error)}")

    def _as_cdr(self, file: Path, message: SalvagedMessage) -> StoredMessage | Damage:
        channel, position = message.channel, f"byte {message.offset}"
        try:
            if channel.encoding == ROS1_ENCODING:
                noetic = get_typestore(Stores.ROS1_NOETIC)
                raw = cdr_from_ros1(message.raw, channel.msgtype, noetic)
            else:
                raw = decompressed(message.raw)
        except UNREADABLE as error:
            text = f"damaged message on {channel.topic!r}: {reason(error)}"
            return Damage(str(file), position, text)
        return StoredMessage(position, message.received_ns, raw, channel.msgtype)


def _is_wanted(
    message: SalvagedMessage, topic: str, start_ns: int | None, stop_ns: int | None
) -> bool:
    is_found = message.channel.topic == topic and message.channel.encoding in ENCODINGS
    after_start = start_ns is None or message.received_ns >= start_ns
    return is_found and after_start and (stop_ns is None or message.received_ns < stop_ns)
