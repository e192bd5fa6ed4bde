"""The messages of one mcap file in the order of the file, also of a damaged one."""

from __future__ import annotations

import struct
from io import BytesIO
from typing import TYPE_CHECKING, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from mnsf_ros.recording.bag_errors import reason
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.mcap_chunks import records_of_chunk
from mnsf_ros.recording.mcap_records import MCAP_ERRORS, Record, read_records
from mnsf_ros.recording.mcap_summary import StoredChannel, Summary, read_summary

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# Channel, sequence number, time of reception and time of publication, then the data.
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")


class StoredMessage(NamedTuple):
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


def read_messages(path: Path, summary: Summary | None = None) -> Iterator[StoredMessage | Damage]:
    """Yields all messages, and a Damage in place of what cannot be read.

    Args:
        path: An mcap file.
        summary: What its index says; read from the file if not given.

    Raises:
        OSError: The file cannot be opened or read.
    """
    if summary is None:
        summary = read_summary(path)
    # The record that tells what a channel is may be damaged: then the index has a copy.
    channels, schemas = dict(summary.channels), dict[int, str]()
    for record in _flat_records(path, summary):
        if isinstance(record, Damage):
            yield record
            continue
        try:
            message = _parsed(record, channels, schemas)
        except MCAP_ERRORS as error:
            yield Damage(str(path), f"byte {record.offset}", f"damaged record: {reason(error)}")
            continue
        if message is not None:
            yield message


def _flat_records(path: Path, summary: Summary) -> Iterator[Record | Damage]:
    for record in read_records(path, summary.chunk_offsets):
        if isinstance(record, Record) and record.opcode == Opcode.CHUNK:
            yield from records_of_chunk(path, record)
        else:
            yield record


def _parsed(
    record: Record, channels: dict[int, StoredChannel], schemas: dict[int, str]
) -> StoredMessage | None:
    if record.opcode == Opcode.MESSAGE:
        number, _, received_ns, _ = _MESSAGE_HEAD.unpack_from(record.payload)
        raw = record.payload[_MESSAGE_HEAD.size :]
        return StoredMessage(record.offset, channels[number], received_ns, raw, record.is_verified)
    if record.opcode == Opcode.SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(record.payload)))
        schemas[schema.id] = schema.name
    elif record.opcode == Opcode.CHANNEL:
        channel = Channel.read(ReadDataStream(BytesIO(record.payload)))
        msgtype = schemas.get(channel.schema_id, "")
        stored = StoredChannel(channel.topic, msgtype, channel.message_encoding)
        channels.setdefault(channel.id, stored)
    return None
