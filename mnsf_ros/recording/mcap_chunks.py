"""The records in a chunk of an mcap file, as far as they are there."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Final

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

from mnsf_ros.recording.bag_errors import reason
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.mcap_records import MCAP_ERRORS, RECORD_HEAD, Record

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# No recorder makes larger ones; a damaged length must not ask for all memory there is.
_MAX_CHUNK_BYTES: Final = 4 * 2**30


def records_of_chunk(path: Path, record: Record) -> Iterator[Record | Damage]:
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
    if chunk.uncompressed_size > _MAX_CHUNK_BYTES:
        raise ValueError(f"chunk claims {chunk.uncompressed_size} bytes")
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    if size != chunk.uncompressed_size:
        raise ValueError(f"chunk has {size} bytes, expected {chunk.uncompressed_size}")
    return bytes(stream.read(size))


def _part(chunk: Chunk) -> bytes:
    """What can be decompressed of the beginning of a chunk."""
    if chunk.compression == "zstd":
        return bytes(zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data))
    if chunk.compression:
        raise ValueError(f"{chunk.compression} cannot be read in part")
    return bytes(chunk.data)
