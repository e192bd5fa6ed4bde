# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The messages of a ROS 1 bag from front to end, for bags whose index is lost.

A recorder writes the index last. A bag that was cut short, or never closed, has none, and no reader
that goes by the index can open it, though the messages are all there up to the cut.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mnsf_ros.decompression import FileBudget, check_size, decompress
from mnsf_ros.recording.bag_reader import StoredMessage
from mnsf_ros.recording.damage import UNREADABLE, Damage, reason

_MAGIC: Final = b"#ROSBAG V2.0\n"
_LENGTH: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<II")
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_KNOWN: Final = frozenset({_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION})
# Larger ones are damaged lengths, which must not ask for all memory there is.
_MAX_HEAD_BYTES: Final = 2**20
_COMPRESSIONS: Final = ("bz2", "lz4")

Fields = dict[str, bytes]
# Number of a connection -> topic, message type, and whether it is latched.
Channels = dict[int, tuple[str, str, bool]]


class _Record(NamedTuple):
    """A record: the fields of its head, its data, and whether the file ends before it does."""

    operation: int
    fields: Fields
    data: bytes
    is_cut: bool = False


def read_ros1_messages(path: Path) -> Iterator[StoredMessage | Damage]:
    """Yields all messages up to the end of the file or the first damage, which comes last.

    Damage is also what makes the file expand to more than its `FileBudget`.

    The messages are serialized as in ROS 1.

    Raises:
        OSError: The file cannot be opened or read.
    """
    size = path.stat().st_size
    channels: Channels = {}
    budget = FileBudget(size, "the ROS 1 bag")
    offset = 0
    with path.open("rb") as file:
        try:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise ValueError("does not begin as a ROS 1 bag does")
            while (offset := file.tell()) < size:
                record = _read_record(file, size)
                if record.operation in (_INDEX, _CHUNK_INFO, _BAG):
                    continue
                yield from _messages(record, path, channels, offset, budget)
                if record.is_cut:
                    raise ValueError(f"the file is cut short, it has {size} bytes")
        except UNREADABLE as error:
            yield Damage(str(path), f"byte {offset}", f"damaged record: {reason(error)}")


def _read_record(file: BinaryIO, size: int) -> _Record:
    length = _length(file)
    if length > _MAX_HEAD_BYTES or file.tell() + length > size:
        raise ValueError(f"no record begins here, found a head of {length} bytes")
    fields = _fields(file.read(length))
    operation = fields["op"][0]
    if operation not in _KNOWN:
        raise ValueError(f"no record begins here, found operation {operation}")
    start, length = file.tell() + _LENGTH.size, _length(file)
    is_cut = start + length > size
    if is_cut and operation != _CHUNK:
        raise ValueError(f"the file is cut short: this record ends at byte {start + length}")
    check_size(length, "this record")
    return _Record(operation, fields, file.read(length), is_cut)


def _length(file: BinaryIO) -> int:
    (length,) = _LENGTH.unpack(file.read(_LENGTH.size))
    return int(length)


def _messages(
    record: _Record, path: Path, channels: Channels, offset: int, budget: FileBudget
) -> Iterator[StoredMessage]:
    """The messages in a record of the file: a chunk, or what older recorders wrote without one."""
    if record.operation != _CHUNK:
        yield from _message(record, path, channels, offset)
        return
    data = _decompressed(record, budget)
    chunk = BytesIO(data)
    while chunk.tell() < len(data):
        try:
            inner = _read_record(chunk, len(data))
        except UNREADABLE:
            if record.is_cut:
                return
            raise
        budget.spend_record()
        yield from _message(inner, path, channels, offset)


def _message(
    record: _Record, path: Path, channels: Channels, offset: int
) -> Iterator[StoredMessage]:
    if record.operation == _CONNECTION:
        (number,) = _LENGTH.unpack(record.fields["conn"])
        topic = record.fields["topic"].decode()
        connection = _fields(record.data)
        package, _, name = connection["type"].decode().partition("/")
        is_latched = connection.get("latching") == b"1"
        channels[number] = topic, f"{package}/msg/{name}", is_latched
    elif record.operation == _MESSAGE:
        (number,) = _LENGTH.unpack(record.fields["conn"])
        seconds, nanoseconds = _TIME.unpack(record.fields["time"])
        received_ns = seconds * 1_000_000_000 + nanoseconds
        topic, msgtype, is_latched = channels[number]
        yield StoredMessage(
            topic, msgtype, received_ns, record.data, path, offset, is_latched=is_latched
        )


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


def _decompressed(chunk: _Record, budget: FileBudget) -> bytes:
    """The content of a chunk, of one that is cut short as much as there is."""
    compression = chunk.fields["compression"].decode("ascii")
    if compression == "none":
        return chunk.data
    if compression not in _COMPRESSIONS:
        raise ValueError(f"compression {compression!r} is not supported")
    claimed = int.from_bytes(chunk.fields["size"], "little")
    return decompress(compression, chunk.data, claimed, is_cut=chunk.is_cut, budget=budget)
