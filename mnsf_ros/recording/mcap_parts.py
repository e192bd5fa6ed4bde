# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Parts of an mcap file: its index at the end, and the records in a chunk, with their checksums."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, Header, Schema

from mnsf_ros.decompression import MAX_BYTES, FileBudget, check_size, decompress
from mnsf_ros.recording.damage import UNREADABLE

MAGIC: Final = b"\x89MCAP0\r\n"
# Opcode and length of a record.
RECORD_HEAD: Final = struct.Struct("<BQ")
# Channel, sequence number, time of reception and time of publication, then the data.
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
# What reading a damaged mcap file may raise.
MCAP_UNREADABLE: Final[tuple[type[Exception], ...]] = (*UNREADABLE, McapError)
_FOOTER_SIZE: Final = RECORD_HEAD.size + 20 + len(MAGIC)


@dataclass(frozen=True)
class Summary:
    """What an intact index says, empty if there is none.

    Attributes:
        chunk_offsets: Where the chunks begin, bytes, ascending.
        schemas: Number of a message type -> its definition.
        channels: Number of a channel -> what it is.
        counts: Topic -> number of messages; None if it is not said.
        num_parts: Number of chunks, and of records that say where the messages of one are.
        is_complete: Whether it has a checksum and says where the messages of each chunk are, so
            that the file can be read by its index.
    """

    chunk_offsets: Sequence[int] = ()
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[str] | None = None
    num_parts: tuple[int, int] = (0, 0)
    is_complete: bool = False

    def types(self) -> dict[str, str]:
        """Returns topic -> message type of what can be read."""
        return {
            channel.topic: schema_name(channel, self.schemas)
            for channel in self.channels.values()
            if channel.message_encoding == "cdr"
        }


def schema_name(channel: Channel, schemas: dict[int, Schema]) -> str:
    """Returns the message type of a channel, empty if it is not known."""
    schema = schemas.get(channel.schema_id)
    return "" if schema is None else schema.name


def has_other_profile(file: BinaryIO) -> bool:
    """Returns whether an mcap file is intact at its beginning, and not one of ROS 2."""
    try:
        file.seek(0)
        magic = file.read(len(MAGIC))
        _, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
        check_size(length, "the header")
        header = Header.read(ReadDataStream(BytesIO(file.read(length))))
    except MCAP_UNREADABLE:
        return False
    return magic == MAGIC and header.profile != "ros2"


def read_summary(path: Path) -> Summary:
    """Returns what the index at the end of an mcap file says, if it is there and intact."""
    try:
        with path.open("rb") as file:
            checksum = _checksum(file)
            return Summary() if checksum is None else _parsed(file, has_checksum=checksum != 0)
    except MCAP_UNREADABLE:
        return Summary()


def _parsed(file: BinaryIO, *, has_checksum: bool) -> Summary:
    file.seek(0)
    found = SeekingReader(file, record_size_limit=MAX_BYTES).get_summary()
    if found is None:
        return Summary()
    counts: Counter[str] | None = None
    if found.statistics is not None:
        counts = Counter()
        for number, count in found.statistics.channel_message_counts.items():
            counts[found.channels[number].topic] += count
    chunks = found.chunk_indexes
    offsets = sorted(chunk.chunk_start_offset for chunk in chunks)
    indexes = [len(chunk.message_index_offsets) for chunk in chunks]
    num_parts = len(chunks), sum(indexes)
    is_complete = has_checksum and bool(indexes) and all(indexes) and counts is not None
    return Summary(offsets, found.schemas, found.channels, counts, num_parts, is_complete)


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
    check_size(size - footer.summary_start, "the index")
    if footer.summary_crc == 0:
        return 0
    file.seek(footer.summary_start)
    # The checksum covers the footer, too, up to itself.
    covered = file.read(size - len(MAGIC) - 4 - footer.summary_start)
    return footer.summary_crc if zlib.crc32(covered) == footer.summary_crc else None


def chunk_content(chunk: Chunk, budget: FileBudget, *, is_cut: bool = False) -> bytes:
    """Returns the records in a chunk, of one that `is_cut` as much as there is.

    Raises:
        ValueError: The chunk is damaged, its checksum is wrong, or it is too large, by itself or
            with all others of its file.
    """
    data, size = chunk.data, chunk.uncompressed_size
    if chunk.compression:
        data = decompress(chunk.compression, data, size, is_cut=is_cut, budget=budget)
    if not is_cut and len(data) != size:
        raise ValueError(f"chunk has {len(data)} bytes, expected {size}")
    if not is_cut and chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the checksum of the chunk is wrong")
    return data


def records_in(content: bytes, budget: FileBudget) -> Iterator[tuple[int, bytes]]:
    """Yields opcode and payload of the records in a chunk.

    Raises:
        ValueError: What follows the last one is no whole record, or the budget of the file is
            spent.
    """
    offset = 0
    while offset < len(content):
        head = content[offset : offset + RECORD_HEAD.size].ljust(RECORD_HEAD.size, b"\0")
        opcode, length = RECORD_HEAD.unpack(head)
        begin = offset + RECORD_HEAD.size
        if opcode == 0 or begin + length > len(content):
            raise ValueError(f"no record {offset} bytes into the chunk")
        budget.spend_record()
        yield opcode, content[begin : begin + length]
        offset = begin + length
