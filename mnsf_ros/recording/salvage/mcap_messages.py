"""The messages of one mcap file in the order of the file, also of a damaged one."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Footer, Schema

from mnsf_ros.recording.damage import Damage, reason
from mnsf_ros.recording.salvage.mcap_records import (
    MAGIC,
    MCAP_ERRORS,
    RECORD_HEAD,
    Record,
    read_records,
)

# Channel, sequence number, time of reception and time of publication, then the data.
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
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
        is_complete: Whether it has a checksum and says where the messages of each chunk are, so
            that the file can be read by its index.
    """

    chunk_offsets: tuple[int, ...] = ()
    channels: dict[int, StoredChannel] = field(default_factory=dict)
    counts: dict[str, int] | None = None
    is_complete: bool = False


class SalvagedMessage(NamedTuple):
    """A message as it is stored.

    Attributes:
        offset: Where its record, or that of its chunk, begins in the file, bytes.
        channel: What it belongs to.
        received_ns: Receive time in nanoseconds.
        raw: The serialized message.
        is_verified: Whether a checksum says that it is what was written.
    """

    offset: int
    channel: StoredChannel
    received_ns: int
    raw: bytes
    is_verified: bool


def read_summary(path: Path) -> Summary:
    """Returns what the index at the end of an mcap file says, if it is there and intact."""
    try:
        with path.open("rb") as file:
            checksum = _checksum(file)
            return Summary() if checksum is None else _parsed(file, has_checksum=checksum != 0)
    except MCAP_ERRORS:
        return Summary()


def _parsed(file: BinaryIO, *, has_checksum: bool) -> Summary:
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
    chunks = summary.chunk_indexes
    offsets = tuple(sorted(chunk.chunk_start_offset for chunk in chunks))
    is_indexed = bool(chunks) and all(chunk.message_index_offsets for chunk in chunks)
    is_complete = has_checksum and is_indexed and counts is not None
    return Summary(offsets, channels, counts, is_complete)


def _checksum(file: BinaryIO) -> int | None:
    """The checksum of an intact index, 0 if it has none; None if it is damaged or missing."""
    size = file.seek(0, 2)
    if size < _FOOTER_SIZE:
        return None
    file.seek(size - _FOOTER_SIZE)
    tail = file.read(_FOOTER_SIZE)
    if not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
        return None
    footer = Footer.read(ReadDataStream(BytesIO(tail[RECORD_HEAD.size :])))
    if not 0 < footer.summary_start < size - _FOOTER_SIZE:
        return None
    if footer.summary_crc == 0:
        return 0
    file.seek(footer.summary_start)
    # The checksum covers the footer, too, up to itself.
    covered = file.read(size - len(MAGIC) - 4 - footer.summary_start)
    return footer.summary_crc if zlib.crc32(covered) == footer.summary_crc else None


def read_messages(path: Path, summary: Summary) -> Iterator[SalvagedMessage | Damage]:
    """Yields all messages, and a Damage in place of what cannot be read.

    Args:
        path: An mcap file.
        summary: What its index says.

    Raises:
        OSError: The file cannot be opened or read.
    """
    # The record that tells what a channel is may be damaged: then the index has a copy.
    channels, schemas = dict(summary.channels), dict[int, str]()
    for record in read_records(path, summary.chunk_offsets):
        if isinstance(record, Damage):
            yield record
            continue
        try:
            message = _message_in(record, channels, schemas)
        except MCAP_ERRORS as error:
            yield Damage(str(path), f"byte {record.offset}", f"damaged record: {reason(error)}")
            continue
        if message is not None:
            yield message


def _message_in(
    record: Record, channels: dict[int, StoredChannel], schemas: dict[int, str]
) -> SalvagedMessage | None:
    if record.opcode == Opcode.MESSAGE:
        number, _, received_ns, _ = _MESSAGE_HEAD.unpack_from(record.payload)
        raw = record.payload[_MESSAGE_HEAD.size :]
        return SalvagedMessage(
            record.offset, channels[number], received_ns, raw, record.is_verified
        )
    if record.opcode == Opcode.SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(record.payload)))
        schemas[schema.id] = schema.name
    elif record.opcode == Opcode.CHANNEL:
        channel = Channel.read(ReadDataStream(BytesIO(record.payload)))
        msgtype = schemas.get(channel.schema_id, "")
        stored = StoredChannel(channel.topic, msgtype, channel.message_encoding)
        channels.setdefault(channel.id, stored)
    return None
