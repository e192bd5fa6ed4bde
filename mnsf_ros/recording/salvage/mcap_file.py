"""The messages of an mcap file in the order of the file, also of a damaged one.

Nothing here trusts an index: a file that was cut short has none, and a damaged one may lie. Where
the index is intact, it is used to find the way back after a hole.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Footer, Schema

from mnsf_ros.decompression import MAX_BYTES, decompress
from mnsf_ros.recording.bag_reader import StoredMessage
from mnsf_ros.recording.damage import UNREADABLE, Damage, reason

_MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")
# Channel, sequence number, time of reception and time of publication, then the data.
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_FOOTER_SIZE: Final = _HEAD.size + 20 + len(_MAGIC)
_NEEDED: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK})
_KNOWN: Final = frozenset(Opcode)
_PRIVATE: Final = 0x80
# What reading a damaged mcap file may raise.
_ERRORS: Final[tuple[type[Exception], ...]] = (*UNREADABLE, McapError)


@dataclass(frozen=True)
class Summary:
    """What an intact index says, empty if there is none.

    Attributes:
        chunk_offsets: Where the chunks begin, bytes, ascending.
        schemas: Number of a message type -> its definition.
        channels: Number of a channel -> what it is.
        counts: Topic -> number of messages; None if it is not said.
        is_complete: Whether it has a checksum and says where the messages of each chunk are, so
            that the file can be read by its index.
    """

    chunk_offsets: Sequence[int] = ()
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[str] | None = None
    is_complete: bool = False

    def types(self) -> dict[str, str]:
        """Returns topic -> message type of what can be read."""
        return {
            channel.topic: _type(channel, self.schemas)
            for channel in self.channels.values()
            if channel.message_encoding == "cdr"
        }


class _Record(NamedTuple):
    """A record, where it or its chunk begins, and whether a checksum fits or its end is missing."""

    offset: int
    opcode: int
    payload: bytes
    is_verified: bool = False
    is_cut: bool = False


def read_summary(path: Path) -> Summary:
    """Returns what the index at the end of an mcap file says, if it is there and intact."""
    try:
        with path.open("rb") as file:
            checksum = _checksum(file)
            return Summary() if checksum is None else _parsed(file, has_checksum=checksum != 0)
    except _ERRORS:
        return Summary()


def _parsed(file: BinaryIO, *, has_checksum: bool) -> Summary:
    file.seek(0)
    found = make_reader(file).get_summary()
    if found is None:
        return Summary()
    counts: Counter[str] | None = None
    if found.statistics is not None:
        counts = Counter()
        for number, count in found.statistics.channel_message_counts.items():
            counts[found.channels[number].topic] += count
    chunks = found.chunk_indexes
    offsets = sorted(chunk.chunk_start_offset for chunk in chunks)
    is_indexed = bool(chunks) and all(chunk.message_index_offsets for chunk in chunks)
    is_complete = has_checksum and is_indexed and counts is not None
    return Summary(offsets, found.schemas, found.channels, counts, is_complete)


def _checksum(file: BinaryIO) -> int | None:
    """The checksum of an intact index, 0 if it has none; None if it is damaged or missing."""
    size = file.seek(0, 2)
    if size < _FOOTER_SIZE:
        return None
    file.seek(size - _FOOTER_SIZE)
    tail = file.read(_FOOTER_SIZE)
    if not tail.endswith(_MAGIC) or tail[0] != Opcode.FOOTER:
        return None
    footer = Footer.read(ReadDataStream(BytesIO(tail[_HEAD.size :])))
    if not 0 < footer.summary_start < size - _FOOTER_SIZE:
        return None
    if footer.summary_crc == 0:
        return 0
    file.seek(footer.summary_start)
    # The checksum covers the footer, too, up to itself.
    covered = file.read(size - len(_MAGIC) - 4 - footer.summary_start)
    return footer.summary_crc if zlib.crc32(covered) == footer.summary_crc else None


def read_mcap_messages(path: Path, summary: Summary) -> Iterator[StoredMessage | Damage]:
    """Yields all messages that ROS 2 can read, and a Damage in place of what cannot be read.

    Raises:
        OSError: The file cannot be opened or read.
    """
    # The record that tells what a channel is may be damaged: then the index has a copy.
    channels, schemas = dict(summary.channels), dict(summary.schemas)
    for record in _records(path, summary.chunk_offsets):
        if isinstance(record, Damage):
            yield record
            continue
        try:
            if record.opcode == Opcode.MESSAGE:
                number, _, received_ns, _ = _MESSAGE_HEAD.unpack_from(record.payload)
                channel = channels[number]
                if channel.message_encoding == "cdr":
                    yield StoredMessage(
                        topic=channel.topic,
                        msgtype=_type(channel, schemas),
                        received_ns=received_ns,
                        raw=record.payload[_MESSAGE_HEAD.size :],
                        file=path,
                        offset=record.offset,
                        is_verified=record.is_verified,
                    )
            elif record.opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(record.payload)))
                schemas.setdefault(schema.id, schema)
            elif record.opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(record.payload)))
                channels.setdefault(channel.id, channel)
        except _ERRORS as error:
            yield Damage(str(path), f"byte {record.offset}", f"damaged record: {reason(error)}")


def _type(channel: Channel, schemas: dict[int, Schema]) -> str:
    schema = schemas.get(channel.schema_id)
    return "" if schema is None else schema.name


def _records(path: Path, chunk_offsets: Sequence[int]) -> Iterator[_Record | Damage]:
    """Yields schemas, channels and messages, also those in chunks."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            yield Damage(str(path), "byte 0", "does not begin as an mcap file does")
        offset: int | None = len(_MAGIC)
        while offset is not None:
            file.seek(offset)
            head = file.read(_HEAD.size)
            opcode, length = _HEAD.unpack(head.ljust(_HEAD.size, b"\0"))
            end = offset + _HEAD.size + length
            number = bisect_right(chunk_offsets, offset)
            onward = chunk_offsets[number] if number < len(chunk_offsets) else None
            is_chunk_known = number > 0 and chunk_offsets[number - 1] == offset
            problem = _problem(opcode, end, size, onward, is_chunk_known=is_chunk_known)
            if len(head) < _HEAD.size:
                problem = f"the file is cut short: it has {size} bytes and no end mark"
            if problem:
                if opcode == Opcode.CHUNK and end > size and onward is None:
                    # Whole messages before the cut are still there.
                    rest = _Record(offset, opcode, file.read(MAX_BYTES), is_cut=True)
                    yield from _records_of_chunk(path, rest)
                yield Damage(str(path), f"byte {offset}", problem)
                offset = onward
                continue
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if opcode == Opcode.CHUNK:
                yield from _records_of_chunk(path, _Record(offset, opcode, file.read(length)))
            elif opcode in _NEEDED:
                yield _Record(offset, opcode, file.read(length))
            offset = end


def _problem(
    opcode: int, end: int, size: int, next_chunk: int | None, *, is_chunk_known: bool
) -> str:
    """Says what is wrong with the head of a record, by itself or by the index, if anything."""
    if opcode not in _KNOWN and opcode < _PRIVATE:
        return f"no record begins here, found opcode {opcode}"
    if end > size:
        return f"the file is cut short: this record ends at byte {end} of {size}"
    if is_chunk_known and opcode != Opcode.CHUNK:
        return f"the index says that a chunk begins here, found opcode {opcode}"
    if next_chunk is not None and end > next_chunk:
        return f"this record reaches beyond the chunk at byte {next_chunk}"
    if next_chunk is not None and opcode in (Opcode.DATA_END, Opcode.FOOTER):
        return f"the data ends before the chunk at byte {next_chunk}"
    return ""


def _records_of_chunk(path: Path, record: _Record) -> Iterator[_Record | Damage]:
    """Yields the records in a chunk, and a Damage if they are not what was written.

    Of a chunk that is cut the whole records are yielded: that the file is cut is reported already.
    """
    where = f"byte {record.offset}"
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(record.payload)))
        data = _content(chunk, is_cut=record.is_cut)
    except _ERRORS as error:
        yield Damage(str(path), where, f"damaged chunk: {reason(error)}")
        return
    is_verified = chunk.uncompressed_crc != 0 and not record.is_cut
    offset = 0
    while offset + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, offset)
        end = offset + _HEAD.size + length
        if opcode == 0 or end > len(data):
            break
        yield _Record(record.offset, opcode, data[offset + _HEAD.size : end], is_verified)
        offset = end
    if offset < len(data) and not record.is_cut:
        yield Damage(str(path), where, f"no record {offset} bytes into the chunk")


def _content(chunk: Chunk, *, is_cut: bool) -> bytes:
    data, size = chunk.data, chunk.uncompressed_size
    if chunk.compression:
        data = decompress(chunk.compression, data, size, is_cut=is_cut)
    if not is_cut and len(data) != size:
        raise ValueError(f"chunk has {len(data)} bytes, expected {size}")
    if not is_cut and chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the checksum of the chunk is wrong")
    return data
