# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""mcap files, read in the order of the file: by the index if it is intact, else from the front.

Chunks are verified by their checksums. A damaged chunk is left out where the index leads on to the
next one; without an index, reading ends at the first damaged length.
"""

import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import replace
from io import SEEK_END
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Footer, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from mnsf_ros.errors import UNREADABLE
from mnsf_ros.recording.bag_topics import CDR, TopicSummary, add_topic, has_latched_profile
from mnsf_ros.recording.storage_file import Damage, Readable, StorageFile
from msg_utils.expansion import MAX_BYTES, expanded

_MAGIC: Final = b"\x89MCAP0\r\n"
# Opcode and length, two offsets and a checksum, and the mark of the end.
_FOOTER_BYTES: Final = 9 + 20 + len(_MAGIC)


class _Place(NamedTuple):
    """A chunk, or a message outside of chunks."""

    offset: int
    end_ns: float  # receive time of its last message
    channels: Collection[int] = ()  # that it has messages of; empty if unknown


class McapFile(StorageFile):
    """An mcap file."""

    def __init__(self, path: Path) -> None:
        """Reads the index, or without an intact one the whole file."""
        super().__init__(path)
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._places: list[_Place] = []
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise EOFError("it does not begin as an mcap file does")
            counts = self._read_index(file)
            if counts is None:
                counts = self._read_all(file)
        for number, channel in self._channels.items():
            schema = self._schemas.get(channel.schema_id)
            is_latched = has_latched_profile(channel.metadata.get("offered_qos_profiles", ""))
            msgtype, encoding = schema.name if schema else "", channel.message_encoding
            if schema and schema.encoding == "omgidl":
                encoding += " of omgidl"  # types of other DDS programs
            summary = TopicSummary(msgtype, counts[number], is_latched, encoding)
            add_topic(self.topics, channel.topic, summary)

    def messages(self, topic: str, start_ns: float) -> Iterator[Readable[bytes]]:
        """Yields receive time and CDR bytes of the messages from a time on, or a Damage."""
        channels = {
            number
            for number, one in self._channels.items()
            if one.topic == topic and one.message_encoding == CDR
        }
        with self.path.open("rb") as file:
            for place in self._places:
                is_other = place.channels and channels.isdisjoint(place.channels)
                if is_other or place.end_ns < start_ns:
                    continue
                try:
                    for message in self._messages_in(_record_at(file, place.offset)):
                        if message.channel_id in channels and message.log_time >= start_ns:
                            yield message.log_time, message.data
                except UNREADABLE as error:
                    yield self._damage(place.offset, error)

    def _damage(self, offset: int, error: Exception, text: str = "damaged chunk") -> Damage:
        return Damage.of(self.path, f"byte {offset}", error, text)

    def _read_index(self, file: BinaryIO) -> Counter[int] | None:
        """Number of messages of each channel; None without an intact index of all messages."""
        try:
            summary, has_checksum = _summary(file)
            if summary is None or summary.statistics is None:
                return None
            chunks = sorted(summary.chunk_indexes, key=lambda one: one.chunk_start_offset)
            if not chunks and summary.statistics.message_count:
                return None
            if chunks:
                offset = chunks[0].chunk_start_offset
                self.has_checksums = has_checksum and _is_checked(file, offset)
        except UNREADABLE as error:
            text = "it has no index that can be read"
            self.damages = [Damage.of(self.path, "", error, text)]
            return None
        self._channels, self._schemas = summary.channels, summary.schemas
        self._places = [
            _Place(one.chunk_start_offset, one.message_end_time, one.message_index_offsets)
            for one in chunks
        ]
        self.first_ns = min((one.message_start_time for one in chunks), default=self.first_ns)
        self.last_ns = max((one.message_end_time for one in chunks), default=self.last_ns)
        return Counter(summary.statistics.channel_message_counts)

    def _read_all(self, file: BinaryIO) -> Counter[int]:
        """Number of messages of each channel up to the end, or to the first damaged length."""
        counts: Counter[int] = Counter()
        found, offset, size = [], len(_MAGIC), file.seek(0, SEEK_END)
        try:
            for record in _records(file, offset):
                if isinstance(record, DataEnd | Footer):
                    break
                try:
                    for message in self._messages_in(record):
                        counts[message.channel_id] += 1
                        self.first_ns = min(self.first_ns, message.log_time)
                        self.last_ns = max(self.last_ns, message.log_time)
                except UNREADABLE as error:
                    found.append(self._damage(offset, error))
                if isinstance(record, Chunk | Message):
                    self._places.append(_Place(offset, float("inf")))
                offset = file.tell()
            else:
                raise EOFError("it has no end mark")
        except UNREADABLE as error:
            text = f"cut short or damaged, the rest of {size} bytes is not read"
            found.append(self._damage(offset, error, text))
        # More informative than the missing index.
        self.damages = found or self.damages
        return counts

    def _messages_in(self, record: object) -> Iterator[Message]:
        """The messages in a record; schemas and channels are kept."""
        if isinstance(record, Chunk):
            for part in self._records_in(record):
                yield from self._messages_in(part)
        elif isinstance(record, Message):
            if record.channel_id not in self._channels:
                raise EOFError(f"the channel {record.channel_id} of a message is not described")
            yield record
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self._channels.setdefault(record.id, record)

    def _records_in(self, chunk: Chunk) -> list[Any]:
        """The records of a chunk; it must have a checksum if the first chunk has one."""
        if chunk.uncompressed_size > MAX_BYTES:
            raise EOFError(f"it claims to expand to {chunk.uncompressed_size} bytes")
        if self.has_checksums and chunk.uncompressed_crc == 0:
            raise EOFError("its checksum is missing")
        if chunk.compression in ("zstd", "lz4"):
            data = expanded(chunk.data, chunk.compression, chunk.uncompressed_size)
            chunk = replace(chunk, compression="", data=data)
        return breakup_chunk(chunk, validate_crc=True)


def _is_checked(file: BinaryIO, offset: int) -> bool:
    """Whether a chunk has a checksum; a damaged one counts as if it had."""
    try:
        return bool(next(_records(file, offset)).uncompressed_crc != 0)
    except UNREADABLE:
        return True


def _record_at(file: BinaryIO, offset: int) -> Any:  # noqa: ANN401
    record = next(_records(file, offset))
    if not isinstance(record, Chunk | Message):
        raise EOFError(f"found a {type(record).__name__}")
    return record


def _records(file: BinaryIO, offset: int) -> Iterator[Any]:
    """The records from a place on, chunks as a whole."""
    file.seek(offset)
    reader = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=MAX_BYTES)
    return iter(reader.records)


def _summary(file: BinaryIO) -> tuple[Summary | None, bool]:
    """The index at the end of an mcap file, if there is one, and whether it has a checksum."""
    size = file.seek(0, SEEK_END)
    file.seek(max(0, size - _FOOTER_BYTES))
    tail = file.read()
    if not tail.endswith(_MAGIC) or tail[0] != Opcode.FOOTER:
        raise EOFError("the file is cut short, it has no end mark")
    footer = next(_records(file, size - _FOOTER_BYTES))
    if footer.summary_start == 0:
        return None, False
    if footer.summary_crc:
        # It covers the footer, too, up to itself.
        num_bytes = size - len(_MAGIC) - 4 - file.seek(footer.summary_start)
        if zlib.crc32(file.read(max(num_bytes, 0))) != footer.summary_crc:
            raise EOFError("its checksum is wrong")
    file.seek(0)
    summary = SeekingReader(file, record_size_limit=MAX_BYTES).get_summary()
    return summary, footer.summary_crc != 0
