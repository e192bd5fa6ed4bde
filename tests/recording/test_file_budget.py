# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One limit for all that a file expands to: it bounds the time that a few kilobytes can take."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from expanding_bags import EXPANDING, MEBIBYTE, ros1_in_turn
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from tiny_bags import NOETIC, stamp

from mnsf_ros.decompression import MAX_BYTES, FileBudget, SizeLimitError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.inspection import inspect_recording

# What a process needs that reads a small recording, and then a few copies of the largest cloud.
PEAK_MIB = 400 + 3 * MAX_BYTES // MEBIBYTE
KINDS = [(name, kind) for name, kinds in EXPANDING.items() for kind in kinds]
COUNT = """
import sys
from pathlib import Path
from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.inspection import inspect_recording
def count(reader):
    number, last = 0, None
    with reader as opened:
        for number, last in enumerate(opened.readable_messages("/points"), 1):
            pass
    print(number, last if isinstance(last, Damage) else "")
def by_index():
    count(BagReader(sys.argv[1]))
def inspected():
    inspection = inspect_recording(sys.argv[1])
    print(sum(topic.count for topic in inspection.topics.values()), *inspection.damages)
    count(inspection.open())
for read in (by_index, inspected):
    try:
        read()
    except RecordingError as error:
        print(0, error)
# Not ru_maxrss: a process inherits the peak of the one that started it through fork and exec.
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


@pytest.mark.parametrize(("name", "kind"), KINDS)
def test_all_parts_of_a_file_have_one_limit(tmp_path, name, kind):
    """The number of messages stands for the time: without the limit there are millions."""
    path = EXPANDING[name][kind](tmp_path / name)
    num_bytes = sum(file.stat().st_size for file in ([path] if path.is_file() else path.iterdir()))
    assert num_bytes < 3 * MEBIBYTE
    command = [sys.executable, "-c", COUNT, path]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    *lines, peak_mib = ended.stdout.splitlines()
    assert int(peak_mib) < PEAK_MIB
    for line in lines:
        assert int(line.split()[0]) <= (MAX_BYTES + 100 * num_bytes) / 1024 + 1
    # Of a bag without an index that has no message at all, the index is told.
    limit = r" of \d+ bytes expands to more than \d+ bytes|^0 .* Bag is not indexed"
    assert re.search(limit, lines[-1]), lines


def test_budget_is_that_of_the_size():
    budget = FileBudget(1000, "the file")
    budget.spend(MAX_BYTES + 100_000 - 1024)
    budget.spend_record()
    assert not budget.is_spent
    text = f"^the file of 1000 bytes expands to more than {MAX_BYTES + 100_000} bytes, counting"
    with pytest.raises(SizeLimitError, match=text):
        budget.spend(1)
    assert budget.is_spent


def mcap_of_small_messages(file, number):
    with file.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.ZSTD)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/Bool", "ros2msg", b"bool data")
        channel = writer.register_channel("/beat", "cdr", schema)
        for index in range(number):
            writer.add_message(channel, stamp(index), b"\0\1\0\0\1", stamp(index))
        writer.finish()


def ros1_of_small_messages(file, number):
    writer = Ros1Writer(file)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer:
        connection = writer.add_connection("/beat", "std_msgs/msg/Bool", typestore=NOETIC)
        for index in range(number):
            writer.write(connection, stamp(index), b"\1")


@pytest.mark.parametrize(
    ("name", "write"), [("a.mcap", mcap_of_small_messages), ("a.bag", ros1_of_small_messages)]
)
def test_many_small_messages_are_read(tmp_path, name, write):
    """More than the budget of a file without size has, which an index makes up for."""
    number = MAX_BYTES // 1024 + 40_000
    write(tmp_path / name, number)
    inspection = inspect_recording(tmp_path / name)
    assert inspection.damages == ()
    assert not inspection.needs_salvage
    with inspection.open() as reader:
        assert sum(1 for _ in reader.raw_messages("/beat")) == number


def test_topics_read_side_by_side_do_not_expand_chunks_again(tmp_path):
    bag = ros1_in_turn(tmp_path / "bag.bag", 12 * MEBIBYTE, ("/one", "/two"))
    with BagReader(bag) as reader:
        scans = [reader.raw_messages(topic) for topic in ("/one", "/two")]
        assert len(list(zip(*scans, strict=True))) == 45
