"""The records of an mcap file one after the other, also of a damaged one.

Nothing here trusts an index: a file that was cut short has none, and a damaged one may lie. Where
the index is intact, it is used to find the way back after a hole.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from zstandard import ZstdError

from mnsf_ros.recording.bag_errors import UNREADABLE
from mnsf_ros.recording.damage import Damage

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_HEAD: Final = struct.Struct("<BQ")
# Of a chunk that seems to be cut short, because a damaged length must not fill the memory.
_MAX_CUT_BYTES: Final = 256 * 2**20
_NEEDED: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK})
_KNOWN: Final = frozenset(Opcode)
_PRIVATE: Final = 0x80
# What reading a damaged mcap file may raise.
MCAP_ERRORS: Final[tuple[type[Exception], ...]] = (*UNREADABLE, McapError, ZstdError)


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
    """Yields schemas, channels, messages and chunks in the order of the file.

    Args:
        path: An mcap file.
        chunk_offsets: Where chunks are known to begin.

    Yields:
        Records, and a Damage in place of what cannot be read.

    Raises:
        OSError: The file cannot be opened or read.
    """
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
    return Record(offset, opcode, file.read(_MAX_CUT_BYTES), is_cut=True)


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
