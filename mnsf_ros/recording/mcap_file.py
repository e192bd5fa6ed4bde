# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""mcap files, read in the order of the file: by the index if it is intact, else from the front.

Chunks are verified by their checksums. A damaged chunk is left out where the index leads on to the
next one; without an index, reading ends at the first damaged length.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Schema
from mcap.summary import Summary

from mnsf_ros.recording.bag_topics import TopicSummary, add_topic, has_latched_profile
from mnsf_ros.recording.compression import MAX_BYTES, expanded
from mnsf_ros.recording.damage import UNREADABLE, Damage

_MAGIC: Final = b"\x89MCAP0\r\n"
# Opcode and length of a record.
_HEAD: Final = struct.Struct("<BQ")
# Channel, sequence number, time of reception and time of publication, then the data.
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_FOOTER_BYTES: Final = _HEAD.size + 20 + len(_MAGIC)
# Where the checksum of a chunk is in its record.
_CHECKSUM: Final = slice(_HEAD.size + 24, _HEAD.size + 28)
_NEEDED: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK)
_OPCODES: Final = frozenset(Opcode)
# From here on programs have opcodes of their own.
_PRIVATE: Final = 0x80
_PIECE_BYTES: Final = 2**20


class _Message(NamedTuple):
    """A message with the number of its channel."""

    channel: int
    received_ns: int
    data: bytes


class McapFile:
    """An mcap file; its attributes are those of `StorageFile`."""

    def __init__(self, path: Path) -> None:
        """Reads the index, or without an intact one the whole file.

        Raises:
            Exception: One of `UNREADABLE`: it is no mcap file.
        """
        self.topics: dict[str, TopicSummary] = {}
        self.first_ns, self.last_ns = float("inf"), 0.0
        self.has_checksums = False
        self.damages: list[Damage] = []
        self._path = path
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        # None: all that is there, from the front.
        self._chunks: list[ChunkIndex] | None = None
        counts = self._read_index()
        if counts is None:
            counts = self._read_all()
        self._summarize(counts)

    def messages(self, topic: str, start_ns: float) -> Iterator[tuple[int, bytes] | Damage]:
        """Yields receive time and CDR bytes of the messages from a time on, or a Damage."""
        channels = {
            number
            for number, one in self._channels.items()
            if one.topic == topic and one.message_encoding == "cdr"
        }
        if self._chunks is None:
            found = self._from_the_front()
        else:
            found = self._of_chunks(self._chunks, channels, start_ns)
        for item in found:
            if isinstance(item, Damage):
                yield item
            elif item.channel in channels and item.received_ns >= start_ns:
                yield item.received_ns, item.data

    def _read_index(self) -> Counter[int] | None:
        """Number of messages of each channel; None without an intact index of all messages."""
        with self._path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise EOFError("it does not begin as an mcap file does")
            try:
                summary, has_checksum = _summary(file)
                if summary is None or summary.statistics is None:
                    return None
                chunks = sorted(summary.chunk_indexes, key=lambda one: one.chunk_start_offset)
                if not chunks and summary.statistics.message_count:
                    return None
                if chunks:
                    file.seek(chunks[0].chunk_start_offset)
                    is_checked = any(file.read(_CHECKSUM.stop)[_CHECKSUM])
                    self.has_checksums = has_checksum and is_checked
            except UNREADABLE as error:
                text = "it has no index that can be read"
                self.damages = [Damage.of(self._path, "", error, text)]
                return None
        self._chunks, self._channels, self._schemas = chunks, summary.channels, summary.schemas
        self.first_ns = min((one.message_start_time for one in chunks), default=self.first_ns)
        self.last_ns = max((one.message_end_time for one in chunks), default=self.last_ns)
        return Counter(summary.statistics.channel_message_counts)

    def _read_all(self) -> Counter[int]:
        """Number of messages of each channel."""
        counts: Counter[int] = Counter()
        found = []
        for item in self._from_the_front():
            if isinstance(item, Damage):
                found.append(item)
            else:
                counts[item.channel] += 1
                self.first_ns = min(self.first_ns, item.received_ns)
                self.last_ns = max(self.last_ns, item.received_ns)
        # They tell more than that the index, which would be behind them, is missing.
        self.damages = found or self.damages
        return counts

    def _summarize(self, counts: Counter[int]) -> None:
        for number, channel in self._channels.items():
            if channel.message_encoding != "cdr":
                continue
            schema = self._schemas.get(channel.schema_id)
            msgtype = schema.name if schema else ""
            is_latched = has_latched_profile(channel.metadata.get("offered_qos_profiles", ""))
            summary = TopicSummary(msgtype, counts[number], is_latched)
            add_topic(self.topics, channel.topic, summary)

    def _of_chunks(
        self, chunks: list[ChunkIndex], channels: set[int], start_ns: float
    ) -> Iterator[_Message | Damage]:
        """The messages of all chunks that have some of the channels from a time on."""
        with self._path.open("rb") as file:
            for chunk in chunks:
                listed = chunk.message_index_offsets
                is_early = chunk.message_end_time < start_ns
                if is_early or (listed and channels.isdisjoint(listed)):
                    continue
                offset = file.seek(chunk.chunk_start_offset)
                try:
                    for opcode, payload in _records(file, offset + chunk.chunk_length):
                        if opcode != Opcode.CHUNK:
                            raise EOFError(f"found a record of kind {opcode}")
                        yield from self._in_chunk(payload)
                except UNREADABLE as error:
                    yield Damage.of(self._path, f"byte {offset}", error, "damaged chunk")

    def _from_the_front(self) -> Iterator[_Message | Damage]:
        """All messages up to the end of the data or the first damaged length."""
        with self._path.open("rb") as file:
            size = file.seek(0, SEEK_END)
            offset = file.seek(len(_MAGIC))
            try:
                for opcode, payload in _records(file, size):
                    if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                        return
                    yield from self._readable(opcode, payload, offset)
                    offset = file.tell()
                raise EOFError("it has no end mark")
            except UNREADABLE as error:
                text = f"cut short or damaged, the rest of {size} bytes is not read"
                yield Damage.of(self._path, f"byte {offset}", error, text)

    def _readable(self, opcode: int, payload: bytes, offset: int) -> Iterator[_Message | Damage]:
        try:
            if opcode == Opcode.CHUNK:
                yield from self._in_chunk(payload)
            elif (message := self._message(opcode, payload)) is not None:
                yield message
        except UNREADABLE as error:
            yield Damage.of(self._path, f"byte {offset}", error, "damaged record")

    def _in_chunk(self, payload: bytes) -> Iterator[_Message]:
        content = _content(payload, is_checked=self.has_checksums)
        for opcode, part in _records(BytesIO(content), len(content)):
            if (message := self._message(opcode, part)) is not None:
                yield message

    def _message(self, opcode: int, payload: bytes) -> _Message | None:
        """The message in a record; schemas and channels are kept."""
        if opcode == Opcode.MESSAGE:
            channel, _, received_ns, _ = _MESSAGE_HEAD.unpack_from(payload)
            if channel not in self._channels:
                raise EOFError(f"the channel {channel} of a message is not described")
            return _Message(channel, received_ns, payload[_MESSAGE_HEAD.size :])
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(payload)))
            self._schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            described = Channel.read(ReadDataStream(BytesIO(payload)))
            self._channels.setdefault(described.id, described)
        return None


def _summary(file: BinaryIO) -> tuple[Summary | None, bool]:
    """The index at the end of an mcap file, if there is one, and whether it has a checksum.

    Raises:
        Exception: One of `UNREADABLE`: it is damaged, or the file is cut short.
    """
    size = file.seek(0, SEEK_END)
    file.seek(max(0, size - _FOOTER_BYTES))
    tail = file.read()
    if not tail.endswith(_MAGIC) or tail[0] != Opcode.FOOTER:
        raise EOFError("the file is cut short, it has no end mark")
    footer = Footer.read(ReadDataStream(BytesIO(tail[_HEAD.size :])))
    if footer.summary_start == 0:
        return None, False
    if footer.summary_crc:
        # It covers the footer, too, up to itself.
        left, checksum = size - len(_MAGIC) - 4 - file.seek(footer.summary_start), 0
        while left > 0 and (piece := file.read(min(left, _PIECE_BYTES))):
            left, checksum = left - len(piece), zlib.crc32(piece, checksum)
        if checksum != footer.summary_crc:
            raise EOFError("its checksum is wrong")
    file.seek(0)
    summary = SeekingReader(file, record_size_limit=MAX_BYTES).get_summary()
    return summary, footer.summary_crc != 0


def _records(file: BinaryIO, end: int) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of each record up to a place; the content of kinds not needed is skipped.

    Raises:
        EOFError: The next one is none, or does not end before that place.
    """
    while (begin := file.tell()) < end:
        opcode, length = _HEAD.unpack(file.read(_HEAD.size).ljust(_HEAD.size, b"\0"))
        left = end - begin - _HEAD.size
        if opcode not in _OPCODES and opcode < _PRIVATE:
            raise EOFError(f"no record of kind {opcode} exists")
        if length > left:
            raise EOFError(f"a record of {length} bytes begins, {max(left, 0)} bytes follow")
        if opcode not in _NEEDED:
            file.seek(length, 1)
            yield opcode, b""
        elif length > MAX_BYTES:
            raise EOFError(f"a record of {length} bytes, expected at most {MAX_BYTES}")
        else:
            yield opcode, file.read(length)


def _content(payload: bytes, *, is_checked: bool) -> bytes:
    """The records in a chunk, which must have a checksum if the chunks of its file have one.

    Raises:
        Exception: One of `UNREADABLE`: the chunk is damaged or too large.
    """
    chunk = Chunk.read(ReadDataStream(BytesIO(payload)))
    data: bytes = chunk.data
    size = chunk.uncompressed_size
    if size > MAX_BYTES:
        raise EOFError(f"it claims to expand to {size} bytes, expected at most {MAX_BYTES}")
    if chunk.compression:
        data = expanded(chunk.compression, data, size)
    if len(data) != size:
        raise EOFError(f"it has {len(data)} bytes, expected {size}")
    if (is_checked or chunk.uncompressed_crc) and zlib.crc32(data) != chunk.uncompressed_crc:
        raise EOFError("its checksum is wrong")
    return data
