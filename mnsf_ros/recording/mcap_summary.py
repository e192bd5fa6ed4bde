"""What the index at the end of an mcap file says, if it is intact."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Footer

from mnsf_ros.recording.mcap_records import MAGIC, MCAP_ERRORS, RECORD_HEAD

if TYPE_CHECKING:
    from pathlib import Path

_FOOTER_SIZE: Final = RECORD_HEAD.size + 20 + len(MAGIC)


class StoredChannel(NamedTuple):
    """What a channel of an mcap file is.

    Attributes:
        topic: Name of the topic.
        msgtype: For example `sensor_msgs/msg/PointCloud2`, empty if unknown.
        encoding: How its messages are serialized, `cdr` in ROS 2.
    """

    topic: str
    msgtype: str
    encoding: str


@dataclass(frozen=True)
class Summary:
    """What an intact index says, empty if there is none.

    Attributes:
        chunk_offsets: Where the chunks begin, bytes, ascending.
        channels: Number of a channel -> what it is.
        counts: Topic -> number of messages; None if it is not said.
    """

    chunk_offsets: tuple[int, ...] = ()
    channels: dict[int, StoredChannel] = field(default_factory=dict)
    counts: dict[str, int] | None = None


def read_summary(path: Path) -> Summary:
    """Returns what the index at the end of an mcap file says, if it is there and intact."""
    try:
        with path.open("rb") as file:
            return _parsed(file) if _is_intact(file) else Summary()
    except MCAP_ERRORS:
        return Summary()


def _parsed(file: BinaryIO) -> Summary:
    file.seek(0)
    summary = make_reader(file).get_summary()
    if summary is None:
        return Summary()
    channels = {}
    for number, channel in summary.channels.items():
        schema = summary.schemas.get(channel.schema_id)
        msgtype = "" if schema is None else schema.name
        channels[number] = StoredChannel(channel.topic, msgtype, channel.message_encoding)
    counts: Counter[str] | None = None
    if summary.statistics is not None:
        counts = Counter()
        for number, count in summary.statistics.channel_message_counts.items():
            counts[channels[number].topic] += count
    offsets = sorted(index.chunk_start_offset for index in summary.chunk_indexes)
    return Summary(tuple(offsets), channels, counts)


def _is_intact(file: BinaryIO) -> bool:
    size = file.seek(0, 2)
    if size < _FOOTER_SIZE:
        return False
    file.seek(size - _FOOTER_SIZE)
    tail = file.read(_FOOTER_SIZE)
    if not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
        return False
    footer = Footer.read(ReadDataStream(BytesIO(tail[RECORD_HEAD.size :])))
    if not 0 < footer.summary_start < size - _FOOTER_SIZE:
        return False
    if footer.summary_crc == 0:
        return True
    file.seek(footer.summary_start)
    # The checksum covers the footer, too, up to itself.
    covered = file.read(size - len(MAGIC) - 4 - footer.summary_start)
    return bool(zlib.crc32(covered) == footer.summary_crc)
