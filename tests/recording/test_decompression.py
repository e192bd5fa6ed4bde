# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small files that expand to gigabytes, and sparse ones: an error with the limit in it, and little
memory.
"""

from __future__ import annotations

import bz2
import os
import re
import sqlite3
import subprocess
import sys
import zlib
from functools import cache

import lz4.frame
import pytest
import tiny_bags
from mcap.opcode import Opcode
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode

from mnsf_ros.decompression import (
    COMPRESSIONS,
    MAX_BYTES,
    DecompressionError,
    SizeLimitError,
    decompress,
)
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.recording.salvage.ros1_file import read_ros1_messages

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

HUGE = 3 * 2**30
MEBIBYTE = 2**20
MCAP_GIB = (2**30).to_bytes(8, "little")
# What a process needs that reads a small recording, and then a few copies of the largest cloud.
PEAK_MIB = 400 + 3 * MAX_BYTES // MEBIBYTE


@cache
def zstd_bomb(size=HUGE, *, is_size_known=False):
    """Zeros: a few hundred kilobytes for gigabytes."""
    compressor = zstd.ZstdCompressor()
    if is_size_known:
        compressor.set_pledged_input_size(size)
    piece = bytes(16 * MEBIBYTE)
    parts = [compressor.compress(piece) for _ in range(size // len(piece))]
    return b"".join(parts) + compressor.flush()


def bz2_bomb(size=HUGE):
    """Many streams, one after the other."""
    return bz2.compress(bytes(8 * MEBIBYTE)) * (size // (8 * MEBIBYTE))


def lz4_bomb(size=HUGE):
    """Many frames, one after the other."""
    frame = lz4.frame.compress(bytes(64 * MEBIBYTE), block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    return frame * (size // (64 * MEBIBYTE))


def zlib_bomb(size=HUGE):
    compressor = zlib.compressobj(9)
    piece = bytes(64 * MEBIBYTE)
    parts = [compressor.compress(piece) for _ in range(size // len(piece))]
    return b"".join(parts) + compressor.flush()


BOMBS = {"bz2": bz2_bomb, "lz4": lz4_bomb, "zlib": zlib_bomb, "zstd": zstd_bomb}
ENCODERS = {
    "bz2": lambda data: bz2.compress(data, 1),
    "lz4": lz4.frame.compress,
    "zlib": zlib.compress,
    "zstd": zstd.compress,
}


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_round_trip_and_cut(name):
    data = os.urandom(MEBIBYTE // 2) + bytes(MEBIBYTE // 4)
    packed = ENCODERS[name](data)
    assert decompress(name, packed) == data
    assert decompress(name, packed, len(data)) == data
    if name != "zlib":
        assert decompress(name, packed + packed) == data + data
    with pytest.raises(
        SizeLimitError, match=f"{len(packed)} bytes .* more than {len(data) - 1} bytes"
    ):
        decompress(name, packed, len(data) - 1)
    half = packed[: len(packed) // 2]
    with pytest.raises(DecompressionError, match="cut short"):
        decompress(name, half)
    part = decompress(name, half, is_cut=True)
    assert part
    assert data.startswith(part)


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_limit_of_memory(name):
    with pytest.raises(SizeLimitError, match=str(MAX_BYTES)):
        decompress(name, BOMBS[name](MAX_BYTES + 64 * MEBIBYTE))
    with pytest.raises(SizeLimitError, match=str(MAX_BYTES)):
        decompress(name, b"", MAX_BYTES + 1)


def mcap_record(opcode, payload):
    return bytes([opcode]) + len(payload).to_bytes(8, "little") + payload


def with_bomb_chunk(file, compression, data, claimed, *, is_cut=False):
    """An mcap file whose chunk, behind a good one, expands to more than it should."""
    bag = tiny_bags.write_mcap(file.with_suffix(""))
    whole = (bag / f"{bag.name}.mcap").read_bytes()
    name = compression.encode()
    head = b"".join(
        (
            tiny_bags.stamp(3).to_bytes(8, "little") * 2,
            claimed.to_bytes(8, "little"),
            bytes(4),
            len(name).to_bytes(4, "little") + name,
            len(data).to_bytes(8, "little"),
        )
    )
    bomb = mcap_record(Opcode.CHUNK, head + data)
    magic, header = whole[:8], whole[8 : 8 + 9 + int.from_bytes(whole[9:17], "little")]
    if is_cut:
        file.write_bytes(magic + header + bomb[: len(bomb) // 2])
        return file
    end = mcap_record(Opcode.DATA_END, bytes(4))
    file.write_bytes(magic + header + bomb + end + mcap_record(Opcode.FOOTER, bytes(20)) + magic)
    return file


def with_bombs_as_messages(write, path, *, is_size_known):
    """A recording in which each message is a zstd frame that expands to gigabytes."""
    bomb = zstd_bomb(HUGE, is_size_known=is_size_known)
    original = tiny_bags.cdr
    try:
        tiny_bags.cdr = lambda *_: bomb
        return write(path, indices=range(1))
    finally:
        tiny_bags.cdr = original


def ros1_bomb(path, compression, size=MAX_BYTES + MEBIBYTE):
    path = path.with_suffix(".bag")
    writer = Ros1Writer(path)
    writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.NOETIC)
        writer.write(connection, tiny_bags.stamp(0), memoryview(bytes(size)))
    return path


def unindexed_ros1_bomb(path):
    """The same, cut before its index."""
    path = ros1_bomb(path, Ros1Writer.CompressionFormat.BZ2)
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"op=\x04") - 20])
    return path


def file_bomb(path):
    bag = tiny_bags.write_mcap(path, mode=CompressionMode.FILE)
    (file,) = bag.glob("*.zstd")
    file.write_bytes(zstd_bomb(HUGE))
    return bag


def sparse_mcap(file, opcode, head):
    """An mcap file with a record of 1 GiB behind its `head`, without a place on the disk."""
    whole = next(tiny_bags.write_mcap(file.with_suffix("")).glob("*.mcap")).read_bytes()
    header = whole[: 8 + 9 + int.from_bytes(whole[9:17], "little")]
    schema = (1).to_bytes(2, "little") + mcap_text(CLOUD_TYPE) + mcap_text("ros2msg") + bytes(4)
    channel = (b"\1\0" * 2) + mcap_text("/points") + mcap_text("cdr") + bytes(4)
    end = mcap_record(Opcode.DATA_END, bytes(4)) + mcap_record(Opcode.FOOTER, bytes(20))
    with file.open("wb") as stream:
        stream.write(header + mcap_record(Opcode.SCHEMA, schema))
        stream.write(mcap_record(Opcode.CHANNEL, channel))
        stream.write(bytes([opcode]) + (len(head) + 2**30).to_bytes(8, "little") + head)
        stream.seek(2**30, os.SEEK_CUR)
        stream.write(end + whole[:8])
    return file


def mcap_text(text):
    return len(text).to_bytes(4, "little") + text.encode()


CRAFTED = {
    "mcap sparse message": lambda p: sparse_mcap(p, Opcode.MESSAGE, b"\1" + bytes(21)),
    "mcap sparse chunk": lambda p: sparse_mcap(
        p, Opcode.CHUNK, bytes(16) + MCAP_GIB + bytes(8) + MCAP_GIB
    ),
    "mcap zstd, small claim": lambda p: with_bomb_chunk(p, "zstd", zstd_bomb(), 100),
    "mcap zstd, large claim": lambda p: with_bomb_chunk(p, "zstd", zstd_bomb(), HUGE),
    "mcap zstd, cut": lambda p: with_bomb_chunk(p, "zstd", zstd_bomb(), HUGE, is_cut=True),
    "mcap zstd, cut, fair claim": lambda p: with_bomb_chunk(
        p, "zstd", zstd_bomb(), MAX_BYTES, is_cut=True
    ),
    "mcap lz4": lambda p: with_bomb_chunk(p, "lz4", lz4_bomb(), 100),
    "mcap lz4, large claim": lambda p: with_bomb_chunk(p, "lz4", lz4_bomb(), HUGE),
    "messages in a folder": lambda p: with_bombs_as_messages(
        tiny_bags.write_mcap, p, is_size_known=False
    ),
    "messages in sqlite3": lambda p: with_bombs_as_messages(
        tiny_bags.write_sqlite, p, is_size_known=False
    ),
    "messages in sqlite3, size known": lambda p: with_bombs_as_messages(
        tiny_bags.write_sqlite, p, is_size_known=True
    ),
    "file": file_bomb,
    "ROS 1 bz2": lambda p: ros1_bomb(p, Ros1Writer.CompressionFormat.BZ2),
    "ROS 1 lz4": lambda p: ros1_bomb(p, Ros1Writer.CompressionFormat.LZ4),
    "ROS 1 without index": unindexed_ros1_bomb,
}
READ = """
import sys
from pathlib import Path
from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.recording.damage import Damage
try:
    inspection = inspect_recording(sys.argv[1])
    print(*inspection.damages, sep="\\n")
    with inspection.open() as reader:
        for topic in reader.topics:
            for item in reader.readable_messages(topic):
                print(item if isinstance(item, Damage) else "message")
except RecordingError as error:
    print(error)
# Not ru_maxrss: a process inherits the peak of the one that started it through fork and exec.
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


@pytest.mark.parametrize("kind", CRAFTED)
def test_crafted_recording_takes_little_memory(tmp_path, kind):
    path = CRAFTED[kind](tmp_path / "bag.mcap" if "mcap" in kind else tmp_path / "bag")
    command = [sys.executable, "-c", READ, path]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    *lines, peak_mib = ended.stdout.splitlines()
    assert int(peak_mib) < PEAK_MIB
    assert "message" not in lines
    # Of files that are cut and have no message, only that they are cut is told.
    if "cut" not in kind and "without index" not in kind:
        limits = (r"\d+ bytes, the limit is \d+", r"\d+ bytes .*expands? to more than \d+ bytes")
        assert any(re.search(limit, line) for line in lines for limit in limits), lines


def test_row_of_sqlite_beyond_the_limit_is_told_with_the_limit(tmp_path):
    bag = tiny_bags.write_sqlite(tmp_path / "bag", indices=range(1))
    with sqlite3.connect(bag / "bag.db3") as connection:
        connection.execute("UPDATE messages SET data = zeroblob(?)", (MAX_BYTES + 1,))
    with inspect_recording(bag).open() as reader:
        (damage,) = reader.readable_messages("/points")
    assert f"more than {MAX_BYTES} bytes" in str(damage)


def test_chunk_far_above_the_usual_size_is_read(tmp_path):
    """Recorders write chunks of 768 KiB to a few MiB; one of 100 MiB is still read."""
    bag = ros1_bomb(tmp_path / "bag", Ros1Writer.CompressionFormat.LZ4, 100 * MEBIBYTE)
    (message,) = read_ros1_messages(bag)
    assert len(message.raw) == 100 * MEBIBYTE
