# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small recordings whose parts, each within its limit, together expand to gigabytes or millions."""

from __future__ import annotations

import bz2
import sys
from functools import cache

import lz4.frame
import tiny_bags
from mcap.opcode import Opcode
from rosbags.rosbag1 import Writer as Ros1Writer

from mnsf_ros.decompression import MAX_BYTES
from mnsf_ros.recording.bag_topics import CLOUD_TYPE

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MEBIBYTE = 2**20
# The checksum of an empty definition.
NO_FIELDS = b"d41d8cd98f00b204e9800998ecf8427e"
MAGIC = b"\x89MCAP0\r\n"
ENCODERS = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstd.compress}


def u16(number):
    return number.to_bytes(2, "little")


def u32(number):
    return number.to_bytes(4, "little")


def u64(number):
    return number.to_bytes(8, "little")


@cache
def repeated(compression, part, size):
    """The same part again and again, and its size: many frames, which are one to readers."""
    piece = part * max(1, 8 * MEBIBYTE // len(part))
    number = size // len(piece)
    return ENCODERS[compression](piece) * number, number * len(piece)


def mcap_text(text):
    return u32(len(text)) + text.encode()


def mcap_record(opcode, payload):
    return bytes([opcode]) + u64(len(payload)) + payload


def mcap_message(size):
    return mcap_record(Opcode.MESSAGE, u16(1) + bytes(20 + size))


def mcap_of_chunks(file, record, size, num_chunks=1, *, has_index=False):
    """An mcap file of chunks of the same record; its index, if any, says a message in each."""
    content, size = repeated("zstd", record, size)
    schema = u16(1) + mcap_text(CLOUD_TYPE) + mcap_text("ros2msg") + bytes(4)
    channel = u16(1) + u16(1) + mcap_text("/points") + mcap_text("cdr") + bytes(4)
    known = mcap_record(Opcode.SCHEMA, schema) + mcap_record(Opcode.CHANNEL, channel)
    data = MAGIC + mcap_record(Opcode.HEADER, mcap_text("ros2") + mcap_text("")) + known
    about = mcap_text("zstd") + u64(len(content))
    chunk = mcap_record(Opcode.CHUNK, bytes(16) + u64(size) + bytes(4) + about + content)
    entries = mcap_record(Opcode.MESSAGE_INDEX, u16(1) + u32(16) + bytes(16))
    index = b""
    for _ in range(num_chunks):
        where = u16(1) + u64(len(data) + len(chunk))
        place = u64(len(data)) + u64(len(chunk)) + u32(len(where)) + where + u64(len(entries))
        index += mcap_record(Opcode.CHUNK_INDEX, bytes(16) + place + about + u64(size))
        data += chunk + entries
    data += mcap_record(Opcode.DATA_END, bytes(4))
    counts = u32(10) + u16(1) + u64(num_chunks)
    numbers = u64(num_chunks) + u16(1) + u32(1) + bytes(8) + u32(num_chunks) + bytes(16)
    summary = known + index + mcap_record(Opcode.STATISTICS, numbers + counts)
    footer = mcap_record(Opcode.FOOTER, u64(len(data) if has_index else 0) + bytes(12))
    file.write_bytes(data + (summary if has_index else b"") + footer + MAGIC)
    return file


def ros1_record(operation, data=b"", **fields):
    pairs = [(b"op", bytes([operation])), *((name.encode(), of) for name, of in fields.items())]
    head = b"".join(u32(len(name) + 1 + len(of)) + name + b"=" + of for name, of in pairs)
    return u32(len(head)) + head + u32(len(data)) + data


def ros1_message(size):
    return ros1_record(2, bytes(size), conn=u32(0), time=bytes(8))


def ros1_of_chunks(file, compression, record, size, num_chunks=1):
    """A ROS 1 bag without an index, of chunks of the same record."""
    content, size = repeated(compression, record, size)
    start = ros1_record(3, index_pos=bytes(8), conn_count=u32(1), chunk_count=u32(num_chunks))
    field = b"type=sensor_msgs/PointCloud2"
    known = ros1_record(7, u32(len(field)) + field, conn=u32(0), topic=b"/points")
    chunk = ros1_record(5, content, compression=compression.encode(), size=u32(size))
    file.write_bytes(b"#ROSBAG V2.0\n" + start + known + chunk * num_chunks)
    return file


def ros1_with_index(file, content, num_entries):
    """A ROS 1 bag with one lz4 chunk, whose index has a message at its begin again and again."""
    field = b"type=sensor_msgs/PointCloud2"
    checksum = b"md5sum=" + NO_FIELDS
    definition = b"message_definition="
    fields = b"".join(u32(len(text)) + text for text in (field, checksum, definition))
    known = ros1_record(7, fields, conn=u32(0), topic=b"/points")
    packed = lz4.frame.compress(content)
    chunk = ros1_record(5, packed, compression=b"lz4", size=u32(len(content)))
    entries = ros1_record(
        4, bytes(12) * num_entries, ver=u32(1), conn=u32(0), count=u32(num_entries)
    )

    def start(position):
        numbers = {"conn_count": u32(1), "chunk_count": u32(1)}
        return b"#ROSBAG V2.0\n" + ros1_record(3, index_pos=u64(position), **numbers)

    first = len(start(0))
    times = {"start_time": bytes(8), "end_time": bytes(8)}
    info = ros1_record(
        6, u32(0) + u32(num_entries), ver=u32(1), chunk_pos=u64(first), **times, count=u32(1)
    )
    body = chunk + entries
    file.write_bytes(start(first + len(body)) + body + known + info)
    return file


def ros1_in_turn(file, num_bytes, topics=("/points",)):
    """An intact ROS 1 bag: by their times, each message is in another of its chunks of zeros."""
    writer = Ros1Writer(file)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    writer.chunk_threshold = num_bytes
    with writer:
        names = [*topics, "/padding"]
        types = [writer.add_connection(n, CLOUD_TYPE, typestore=tiny_bags.NOETIC) for n in names]
        raw = tiny_bags.JAZZY.cdr_to_ros1(tiny_bags.cdr(0), CLOUD_TYPE)
        for chunk in range(3):
            for number in range(chunk, 90, 3):
                writer.write(types[number % len(topics)], tiny_bags.stamp(number), raw)
            writer.write(types[-1], tiny_bags.stamp(100), bytes(num_bytes))
    return file


def sqlite_of_messages(path, size, number):
    """Each message is a zstd frame."""
    content, _ = repeated("zstd", bytes(size), size)
    original = tiny_bags.cdr
    try:
        tiny_bags.cdr = lambda *_: content
        return tiny_bags.write_sqlite(path, indices=range(number))
    finally:
        tiny_bags.cdr = original


MESSAGE = mcap_message(0)
# Nine bytes that no reader needs.
RECORD = mcap_record(0x80, b"")
LARGE = 100 * MEBIBYTE
EXPANDING = {
    "bag.mcap": {
        "messages": lambda p: mcap_of_chunks(p, MESSAGE, MAX_BYTES),
        "messages, index": lambda p: mcap_of_chunks(p, MESSAGE, MAX_BYTES, has_index=True),
        "messages, chunks": lambda p: mcap_of_chunks(p, MESSAGE, MAX_BYTES // 8, 100),
        "records, index": lambda p: mcap_of_chunks(p, RECORD, MAX_BYTES, has_index=True),
        "records": lambda p: mcap_of_chunks(p, RECORD, MAX_BYTES),
        "large chunks": lambda p: mcap_of_chunks(p, mcap_message(LARGE), 2 * LARGE, 100),
        "large chunks, index": lambda p: mcap_of_chunks(
            p, mcap_message(LARGE), 2 * LARGE, 100, has_index=True
        ),
    },
    "bag.bag": {
        "messages, bz2": lambda p: ros1_of_chunks(p, "bz2", ros1_message(0), MAX_BYTES),
        "messages, lz4": lambda p: ros1_of_chunks(p, "lz4", ros1_message(0), MAX_BYTES),
        "records": lambda p: ros1_of_chunks(p, "lz4", ros1_record(6), MAX_BYTES),
        "large chunks": lambda p: ros1_of_chunks(p, "bz2", ros1_message(LARGE), 2 * LARGE, 20),
        "chunks in turn": lambda p: ros1_in_turn(p, 80 * MEBIBYTE),
    },
    "bag": {"messages in sqlite3": lambda p: sqlite_of_messages(p, LARGE, 100)},
}
