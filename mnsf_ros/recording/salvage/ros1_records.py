"""The messages of a ROS 1 bag from front to end, for bags whose index is lost.

A recorder writes the index last. A bag that was cut short, or never closed, has none, and no reader
that goes by the index can open it, though the messages are all there up to the cut.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mnsf_ros.decompression import check_size, decompress
from mnsf_ros.recording.damage import UNREADABLE, Damage, reason
from mnsf_ros.recording.salvage.mcap_messages import SalvagedMessage, StoredChannel

# How the messages are serialized, beside `cdr` in ROS 2.
ROS1_ENCODING: Final = "ros1"
_MAGIC: Final = b"#ROSBAG V2.0\n"
_LENGTH: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<II")
_NUMBER: Final = struct.Struct("<I")
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_KNOWN: Final = frozenset({_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION})
# Larger ones are damaged lengths, which must not ask for all memory there is.
_MAX_HEAD_BYTES: Final = 2**20
_COMPRESSIONS: Final = ("bz2", "lz4")

Fields = dict[str, bytes]
Channels = dict[int, StoredChannel]


class _Record(NamedTuple):
    """A record: the fields of its head, its data, and whether the file ends before it does."""

    operation: int
    fields: Fields
    data: bytes
    is_cut: bool = False


def read_ros1_messages(path: Path) -> Iterator[SalvagedMessage | Damage]:
    """Yields all messages up to the end of the file or the first damage, which comes last.

    Args:
        path: A ROS 1 bag of version 2.0.

    Raises:
        OSError: The file cannot be opened or read.
    """
    size = path.stat().st_size
    channels: Channels = {}
    offset = 0
    with path.open("rb") as file:
        try:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise ValueError("does not begin as a ROS 1 bag does")
            while (offset := file.tell()) < size:
                record = _read_record(file, size)
                if record.operation in (_INDEX, _CHUNK_INFO, _BAG):
                    continue
                yield from _messages(record, channels, offset)
                if record.is_cut:
                    raise ValueError(f"the file is cut short, it has {size} bytes")
        except UNREADABLE as error:
            yield Damage(str(path), f"byte {offset}", f"damaged record: {reason(error)}")


def _read_record(file: BinaryIO, size: int) -> _Record:
    fields = _fields(_part(file, size, _MAX_HEAD_BYTES))
    operation = fields["op"][0]
    if operation not in _KNOWN:
        raise ValueError(f"no record begins here, found operation {operation}")
    start, length = file.tell() + _LENGTH.size, _length(file)
    is_cut = start + length > size
    if is_cut and operation != _CHUNK:
        raise ValueError(f"the file is cut short: this record ends at byte {start + length}")
    check_size(length, "this record")
    return _Record(operation, fields, file.read(length), is_cut)


def _part(file: BinaryIO, size: int, limit: int) -> bytes:
    length = _length(file)
    if length > limit or file.tell() + length > size:
        raise ValueError(f"no record begins here, found a head of {length} bytes")
    return file.read(length)


def _length(file: BinaryIO) -> int:
    (length,) = _LENGTH.unpack(file.read(_LENGTH.size))
    return int(length)


def _messages(record: _Record, channels: Channels, offset: int) -> Iterator[SalvagedMessage]:
    """The messages in a record of the file: a chunk, or what older recorders wrote without one."""
    if record.operation != _CHUNK:
        yield from _message(record, channels, offset)
        return
    data = _decompressed(record)
    position = 0
    while position < len(data):
        found = _record_at(data, position)
        if found is None:
            if record.is_cut:
                return
            raise ValueError(f"no record {position} bytes into the chunk")
        inner, position = found
        yield from _message(inner, channels, offset)


def _record_at(data: bytes, position: int) -> tuple[_Record, int] | None:
    """The record at a position of a chunk, and where the next one begins; None if it is cut."""
    parts = []
    for _ in range(2):
        begin = position + _LENGTH.size
        if begin > len(data):
            return None
        (length,) = _LENGTH.unpack_from(data, position)
        position = begin + length
        if position > len(data):
            return None
        parts.append(data[begin:position])
    fields = _fields(parts[0])
    return _Record(fields["op"][0], fields, parts[1]), position


def _message(record: _Record, channels: Channels, offset: int) -> Iterator[SalvagedMessage]:
    if record.operation == _CONNECTION:
        (number,) = _NUMBER.unpack(record.fields["conn"])
        topic = record.fields["topic"].decode()
        package, _, name = _fields(record.data)["type"].decode().partition("/")
        channels[number] = StoredChannel(topic, f"{package}/msg/{name}", ROS1_ENCODING)
    elif record.operation == _MESSAGE:
        (number,) = _NUMBER.unpack(record.fields["conn"])
        seconds, nanoseconds = _TIME.unpack(record.fields["time"])
        received_ns = seconds * 1_000_000_000 + nanoseconds
        yield SalvagedMessage(offset, channels[number], received_ns, record.data, is_verified=False)


def _fields(head: bytes) -> Fields:
    fields, position = {}, 0
    while position < len(head):
        (length,) = _LENGTH.unpack_from(head, position)
        position += _LENGTH.size
        name, equals, value = head[position : position + length].partition(b"=")
        if not equals or position + length > len(head):
            raise ValueError("the head of this record is damaged")
        fields[name.decode("ascii")] = value
        position += length
    return fields


def _decompressed(chunk: _Record) -> bytes:
    """The content of a chunk, of one that is cut short as much as there is."""
    compression = chunk.fields["compression"].decode("ascii")
    if compression == "none":
        return chunk.data
    if compression not in _COMPRESSIONS:
        raise ValueError(f"compression {compression!r} is not supported")
    claimed = int.from_bytes(chunk.fields["size"], "little")
    return decompress(compression, chunk.data, claimed, is_cut=chunk.is_cut)
