# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small recordings that expand to gigabytes or millions of messages, or compute for ever."""

import bz2
import sqlite3
import struct
import sys
from contextlib import closing
from functools import cache
from itertools import pairwise

import tiny_bags
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode

from msg_utils.other_clouds import CLOUD_TYPE

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MEBIBYTE = 2**20


def u32(number):
    return number.to_bytes(4, "little")


def mcap_of_chunks(file, size, num_chunks, compression=CompressionType.ZSTD):
    """An mcap file of compressed chunks, each with a message of so many zeros."""
    with file.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=size, compression=compression)
        writer.start("ros2")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", b"")
        channel = writer.register_channel("/points", "cdr", schema)
        for number in range(num_chunks):
            writer.add_message(channel, number, bytes(size), number)
        writer.finish()
    return file


def ros1_with_index(file, size):
    """A ROS 1 bag with an index, whose only message has so many zeros."""
    writer = Ros1Writer(file)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer:
        connection = writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.NOETIC)
        writer.write(connection, 1, bytes(16 * MEBIBYTE))
    data = file.read_bytes()
    # The content of the chunk is replaced by one that expands to more.
    start = data.index(b"BZh") - 4
    old = int.from_bytes(data[start : start + 4], "little")
    # Many streams, which are one to readers.
    content = bz2.compress(bytes(MEBIBYTE)) * (size // MEBIBYTE)
    moved = len(content) - old
    data = data[:start] + u32(len(content)) + content + data[start + 4 + old :]
    place = data.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(data[place : place + 8], "little") + moved
    file.write_bytes(data[:place] + index.to_bytes(8, "little") + data[place + 8 :])
    return file


def with_messages(write, path, content):
    """A recording whose messages are all the same bytes."""
    original = tiny_bags.cdr
    try:
        tiny_bags.cdr = lambda *_: content
        return write(path, indices=range(3))
    finally:
        tiny_bags.cdr = original


def compressed_as_a_whole(path):
    """A folder whose file expands to 3 GB of zeros."""
    bag = tiny_bags.write_mcap(path, mode=CompressionMode.FILE)
    (file,) = bag.glob("*.zstd")
    file.write_bytes(zstd_frame(3 * 2**30))
    return bag


@cache
def zstd_frame(size):
    """A single frame of zeros: a few hundred kilobytes for gigabytes."""
    compressor = zstd.ZstdCompressor()
    piece = bytes(16 * MEBIBYTE)
    return b"".join(compressor.compress(piece) for _ in range(size // len(piece))) + (
        compressor.flush()
    )


def database_of(path, script, **options):
    """A database of rosbag2 that a script has changed."""
    (file,) = tiny_bags.write_sqlite(path, **options).glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.executescript(script)
    return file


def endless_view(path):
    """A database whose table is a view that computes for ever."""
    script = """DROP TABLE topics; CREATE VIEW topics AS
        WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)
        SELECT count(*) AS id, 'a' AS name, 'b' AS type, 'cdr' AS serialization_format FROM c"""
    return database_of(path, script)


def endless_tree(path):
    """A page of the table leads to the next one many times, that one to the next, and so on."""
    size = 512
    script = f"""PRAGMA page_size = {size}; VACUUM;
        WITH c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c LIMIT 800)
        INSERT INTO messages(topic_id, timestamp, data) SELECT 1, x, 'abcdefgh' FROM c"""
    file = database_of(path, script, indices=range(1))
    with closing(sqlite3.connect(file)) as database:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        ((root,),) = database.execute(query)
    data = bytearray(file.read_bytes())
    inner = data[size * (root - 1) : size * root]
    (num_cells,) = struct.unpack_from(">xxxH", inner)
    last_child, *cells = 8, *struct.unpack_from(f">{num_cells}H", inner, 12)
    chain = [root, *(struct.unpack_from(">I", inner, cell)[0] for cell in cells[:15])]
    for page, following in pairwise(chain):
        for place in (last_child, *cells):
            struct.pack_into(">I", inner, place, following)
        data[size * (page - 1) : size * page] = inner
    file.write_bytes(data)
    return file


HOSTILE = {
    "mcap, large chunks": lambda p: mcap_of_chunks(p / "a.mcap", 200 * MEBIBYTE, 10),
    "mcap, large lz4 chunks": lambda p: mcap_of_chunks(
        p / "a.mcap", 200 * MEBIBYTE, 10, CompressionType.LZ4
    ),
    "mcap, messages of 3 GB": lambda p: with_messages(
        tiny_bags.write_mcap, p / "a", zstd_frame(3 * 2**30)
    ),
    "sqlite, messages of 3 GB": lambda p: with_messages(
        tiny_bags.write_sqlite, p / "a", zstd_frame(3 * 2**30)
    ),
    "sqlite, row of 990 MB": lambda p: database_of(
        p / "a", "UPDATE messages SET data = zeroblob(990000000) WHERE id = 2"
    ),
    "sqlite, endless view": lambda p: endless_view(p / "a"),
    "file of 3 GB": lambda p: compressed_as_a_whole(p / "a"),
    "ROS 1, bz2 of 3 GB": lambda p: ros1_with_index(p / "a.bag", 3 * 2**30),
}
