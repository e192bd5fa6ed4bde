# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The messages of an mcap file in the order of the file, also of a damaged one.

Nothing here trusts an index: a file that was cut short has none, and a damaged one may lie. Where
the index is intact, it is used to find the way back after a hole.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from mnsf_ros.decompression import MAX_BYTES, FileBudget
from mnsf_ros.recording.bag_reader import StoredMessage
from mnsf_ros.recording.bag_topics import has_latched_profile
from mnsf_ros.recording.damage import Damage, reason
from mnsf_ros.recording.mcap_parts import (
    MAGIC,
    MCAP_UNREADABLE,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Summary,
    chunk_content,
    records_in,
    schema_name,
)

_NEEDED: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK})
_KNOWN: Final = frozenset(Opcode)
_PRIVATE: Final = 0x80


class _Record(NamedTuple):
    """A record, where it or its chunk begins, and whether a checksum fits or its end is missing."""

    offset: int
    opcode: int
    payload: bytes
    is_verified: bool = False
    is_cut: bool = False


def read_mcap_messages(path: Path, summary: Summary) -> Iterator[StoredMessage | Damage]:
    """Yields all messages that ROS 2 can read, and a Damage in place of what cannot be read.

    Raises:
        OSError: The file cannot be opened or read.
    """
    # The record that tells what a channel is may be damaged: then the index has a copy.
    channels, schemas = dict(summary.channels), dict(summary.schemas)
    latched = {number for number, channel in channels.items() if _is_latched(channel)}
    for record in _records(path, summary.chunk_offsets):
        if isinstance(record, Damage):
            yield record
            continue
        try:
            if record.opcode == Opcode.MESSAGE:
                number, _, received_ns, _ = MESSAGE_HEAD.unpack_from(record.payload)
                channel = channels[number]
                if channel.message_encoding == "cdr":
                    yield StoredMessage(
                        topic=channel.topic,
                        msgtype=schema_name(channel, schemas),
                        received_ns=received_ns,
                        raw=record.payload[MESSAGE_HEAD.size :],
                        file=path,
                        offset=record.offset,
                        is_verified=record.is_verified,
                        is_latched=number in latched,
                    )
            elif record.opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(record.payload)))
                schemas.setdefault(schema.id, schema)
            elif record.opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(record.payload)))
                if channel.id not in channels:
                    channels[channel.id] = channel
                    latched |= {channel.id} if _is_latched(channel) else set()
        except MCAP_UNREADABLE as error:
            yield Damage(str(path), f"byte {record.offset}", f"damaged record: {reason(error)}")


def _is_latched(channel: Channel) -> bool:
    return has_latched_profile(channel.metadata.get("offered_qos_profiles", ""))


def _records(path: Path, chunk_offsets: Sequence[int]) -> Iterator[_Record | Damage]:
    """Yields schemas, channels and messages, also those in chunks."""
    size = path.stat().st_size
    budget = FileBudget(size, "the mcap file")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            yield Damage(str(path), "byte 0", "does not begin as an mcap file does")
        offset: int | None = len(MAGIC)
        while offset is not None:
            file.seek(offset)
            head = file.read(RECORD_HEAD.size)
            opcode, length = RECORD_HEAD.unpack(head.ljust(RECORD_HEAD.size, b"\0"))
            end = offset + RECORD_HEAD.size + length
            number = bisect_right(chunk_offsets, offset)
            onward = chunk_offsets[number] if number < len(chunk_offsets) else None
            is_chunk_known = number > 0 and chunk_offsets[number - 1] == offset
            problem = _problem(opcode, end, size, onward, is_chunk_known=is_chunk_known)
            if len(head) < RECORD_HEAD.size:
                problem = f"the file is cut short: it has {size} bytes and no end mark"
            if problem:
                if opcode == Opcode.CHUNK and end > size and onward is None:
                    # Whole messages before the cut are still there.
                    rest = _Record(offset, opcode, file.read(MAX_BYTES), is_cut=True)
                    yield from _records_of_chunk(path, rest, budget)
                yield Damage(str(path), f"byte {offset}", problem)
                offset = onward
                continue
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if opcode in _NEEDED and length > MAX_BYTES:
                text = f"this record has {length} bytes, the limit is {MAX_BYTES} bytes"
                yield Damage(str(path), f"byte {offset}", text)
            elif opcode == Opcode.CHUNK:
                record = _Record(offset, opcode, file.read(length))
                yield from _records_of_chunk(path, record, budget)
                if budget.is_spent:
                    return
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


def _records_of_chunk(
    path: Path, record: _Record, budget: FileBudget
) -> Iterator[_Record | Damage]:
    """Yields the records in a chunk, and a Damage if they are not what was written.

    Of a chunk that is cut the whole records are yielded: that the file is cut is reported already.
    """
    where = f"byte {record.offset}"
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(record.payload)))
        data = chunk_content(chunk, budget, is_cut=record.is_cut)
    except MCAP_UNREADABLE as error:
        yield Damage(str(path), where, f"damaged chunk: {reason(error)}")
        return
    is_verified = chunk.uncompressed_crc != 0 and not record.is_cut
    try:
        for opcode, payload in records_in(data, budget):
            yield _Record(record.offset, opcode, payload, is_verified)
    except ValueError as error:
        if not record.is_cut or budget.is_spent:
            yield Damage(str(path), where, str(error))
