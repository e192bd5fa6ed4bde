"""The records of an mcap file one after the other, also of a damaged one.

Nothing here trusts an index: a file that was cut short has none, and a damaged one may lie. Where
the index is intact, it is used to find the way back after a hole.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk

from mnsf_ros.decompression import MAX_BYTES, decompress
from mnsf_ros.recording.damage import UNREADABLE, Damage, reason

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_HEAD: Final = struct.Struct("<BQ")
_NEEDED: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK})
_KNOWN: Final = frozenset(Opcode)
_PRIVATE: Final = 0x80
# What reading a damaged mcap file may raise.
MCAP_ERRORS: Final[tuple[type[Exception], ...]] = (*UNREADABLE, McapError)


class Record(NamedTuple):
    """A record of an mcap file.

    Attributes:
        offset: Where it begins in the file, or the chunk that it is in, bytes.
        opcode: What it is.
        payload: Its content.
        is_verified: Whether a checksum says that the content is what was written.
        is_cut: Whether the file ends before the record does.
    """

    offset: int
    opcode: int
    payload: bytes
    is_verified: bool = False
    is_cut: bool = False


def read_records(path: Path, chunk_offsets: tuple[int, ...] = ()) -> Iterator[Record | Damage]:
    """Yields schemas, channels and messages in the order of the file, also those in chunks.

    Args:
        path: An mcap file.
        chunk_offsets: Where chunks are known to begin.

    Yields:
        Records, and a Damage in place of what cannot be read.

    Raises:
        OSError: The file cannot be opened or read.
    """
    for record in _records_of_file(path, chunk_offsets):
        if isinstance(record, Record) and record.opcode == Opcode.CHUNK:
            yield from _records_of_chunk(path, record)
        else:
            yield record


def _records_of_file(path: Path, chunk_offsets: tuple[int, ...]) -> Iterator[Record | Damage]:
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            yield Damage(str(path), "byte 0", "does not begin as an mcap file does")
        offset = len(MAGIC)
        while offset is not None:
            record = _read_record(file, offset, size, chunk_offsets)
            if isinstance(record, str):
                onward = bisect_right(chunk_offsets, offset)
                is_last = onward == len(chunk_offsets)
                rest = _cut_chunk(file, offset, size) if is_last else None
                if rest is not None:
                    yield rest
                yield Damage(str(path), f"byte {offset}", record)
                if is_last:
                    return
                offset = chunk_offsets[onward]
                continue
            if record.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            offset = file.tell()
            if record.opcode in _NEEDED:
                yield record


def _cut_chunk(file: BinaryIO, offset: int, size: int) -> Record | None:
    """What is left of a chunk that reaches beyond the end of the file."""
    file.seek(offset)
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return None
    opcode, length = RECORD_HEAD.unpack(head)
    if opcode != Opcode.CHUNK or offset + RECORD_HEAD.size + length <= size:
        return None
    return Record(offset, opcode, file.read(MAX_BYTES), is_cut=True)


def _read_record(
    file: BinaryIO, offset: int, size: int, chunk_offsets: tuple[int, ...]
) -> Record | str:
    """Reads the record at an offset and leaves the file behind it, or says why there is none."""
    file.seek(offset)
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return f"the file is cut short: it has {size} bytes and no end mark"
    opcode, length = RECORD_HEAD.unpack(head)
    end = offset + RECORD_HEAD.size + length
    if opcode not in _KNOWN and opcode < _PRIVATE:
        return f"no record begins here, found opcode {opcode}"
    if end > size:
        return f"the file is cut short: this record ends at byte {end} of {size}"
    contradiction = _against_index(offset, end, opcode, chunk_offsets)
    if contradiction:
        return contradiction
    if opcode not in _NEEDED:
        file.seek(end)
        return Record(offset, opcode, b"")
    return Record(offset, opcode, file.read(length))


def _against_index(offset: int, end: int, opcode: int, chunk_offsets: tuple[int, ...]) -> str:
    """Says what the index knows better about a record, if anything."""
    number = bisect_right(chunk_offsets, offset)
    if number and chunk_offsets[number - 1] == offset and opcode != Opcode.CHUNK:
        return f"the index says that a chunk begins here, found opcode {opcode}"
    if number == len(chunk_offsets):
        return ""
    if end > chunk_offsets[number]:
        return f"this record reaches beyond the chunk at byte {chunk_offsets[number]}"
    if opcode in (Opcode.DATA_END, Opcode.FOOTER):
        return f"the data ends before the chunk at byte {chunk_offsets[number]}"
    return ""


def _records_of_chunk(path: Path, record: Record) -> Iterator[Record | Damage]:
    """Yields the records in a chunk, and a Damage if they are not what was written.

    Args:
        path: The file, for reports.
        record: The chunk. Of one that is cut short the whole records are yielded without a
            Damage: that the file is cut is reported already.
    """
    where = f"byte {record.offset}"
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(record.payload)))
        data = _part(chunk) if record.is_cut else _content(chunk)
    except MCAP_ERRORS as error:
        yield Damage(str(path), where, f"damaged chunk: {reason(error)}")
        return
    is_verified = chunk.uncompressed_crc != 0 and not record.is_cut
    offset = 0
    while offset + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        end = offset + RECORD_HEAD.size + length
        if opcode == 0 or end > len(data):
            break
        payload = data[offset + RECORD_HEAD.size : end]
        yield Record(record.offset, opcode, payload, is_verified)
        offset = end
    if offset < len(data) and not record.is_cut:
        yield Damage(str(path), where, f"no record {offset} bytes into the chunk")


def _content(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression:
        data = decompress(chunk.compression, data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"chunk has {len(data)} bytes, expected {chunk.uncompressed_size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the checksum of the chunk is wrong")
    return data


def _part(chunk: Chunk) -> bytes:
    """What can be decompressed of the beginning of a chunk."""
    if not chunk.compression:
        return chunk.data
    return decompress(chunk.compression, chunk.data, chunk.uncompressed_size, is_cut=True)
