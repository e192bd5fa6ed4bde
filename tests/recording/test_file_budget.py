# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One limit for all that a file expands to: it bounds the time that a few kilobytes can take."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
import tiny_bags
from expanding_bags import (
    EXPANDING,
    MEBIBYTE,
    mcap_message,
    mcap_of_chunks,
    ros1_in_turn,
    ros1_message,
    ros1_record,
    ros1_with_index,
    u32,
    zstd,
)
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode
from tiny_bags import NOETIC, stamp

from mnsf_ros.decompression import MAX_BYTES, FileBudget, SizeLimitError, decompress
from mnsf_ros.errors import NoIndexError, RecordingError
from mnsf_ros.recording import bag_reader
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.recording.salvage import mcap_file

# What a process needs that reads a small recording, and then a few copies of the largest cloud.
PEAK_MIB = 400 + 3 * MAX_BYTES // MEBIBYTE
MAX_CPU_S = 60
KINDS = [(name, kind) for name, kinds in EXPANDING.items() for kind in kinds]
COUNT = """
import sys
import time
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
print(time.process_time())
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


@pytest.mark.parametrize(("name", "kind"), KINDS)
def test_all_parts_of_a_file_have_one_limit(tmp_path, name, kind):
    """Few messages, little memory, and less CPU than the promised minute."""
    path = EXPANDING[name][kind](tmp_path / name)
    num_bytes = sum(file.stat().st_size for file in ([path] if path.is_file() else path.iterdir()))
    assert num_bytes < 3 * MEBIBYTE
    command = [sys.executable, "-c", COUNT, path]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    *lines, cpu_s, peak_mib = ended.stdout.splitlines()
    assert float(cpu_s) < MAX_CPU_S
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


def budgets(monkeypatch):
    """The sizes of the files that budgets are made for."""
    sizes = []

    def budget(file_bytes, what):
        sizes.append(file_bytes)
        return FileBudget(file_bytes, what)

    monkeypatch.setattr(bag_reader, "FileBudget", budget)
    return sizes


def test_links_that_lead_nowhere_do_not_take_the_budget(tmp_path, monkeypatch):
    sizes = budgets(monkeypatch)
    bag = tiny_bags.write_mcap(tmp_path / "bag")
    (bag / "old.mcap").symlink_to("/nowhere/old.mcap")
    with BagReader(bag) as reader:
        assert list(reader.messages("/points"))
    assert sizes == [(bag / "bag.mcap").stat().st_size]


def test_files_that_are_compressed_as_a_whole_have_the_budget_of_what_is_in_them(
    tmp_path, monkeypatch
):
    sizes = budgets(monkeypatch)
    plain, packed = (
        tiny_bags.write_mcap(tmp_path / name, mode=mode)
        for name, mode in (("plain", CompressionMode.NONE), ("packed", CompressionMode.FILE))
    )
    for bag in (plain, packed):
        with BagReader(bag) as reader:
            assert list(reader.messages("/points"))
    (file,) = packed.glob("*.zstd")
    assert sizes[1] > file.stat().st_size
    assert sizes[1] == pytest.approx(sizes[0], abs=100)


def test_many_frames_are_refused():
    frame = zstd.compress(b"")
    assert decompress("zstd", frame * 1000) == b""
    with pytest.raises(SizeLimitError, match="zstd data has more than 1000 frames"):
        decompress("zstd", frame * 1001)


def test_chunks_that_overlap_in_time_are_read_one_by_one(tmp_path):
    message = mcap_message(100 * MEBIBYTE)
    one, many = (
        mcap_of_chunks(tmp_path / f"{n}.mcap", message, len(message), n, has_index=True)
        for n in (1, 6)
    )
    with BagReader(one):
        pass
    with (
        pytest.raises(NoIndexError, match="too many chunks of a file overlap in time"),
        BagReader(many),
    ):
        pass


def test_what_is_not_compressed_is_counted_too(tmp_path, monkeypatch):
    bag = tiny_bags.write_ros1(tmp_path / "bag.bag")

    def nearly_spent(file_bytes, what):
        budget = FileBudget(file_bytes, what)
        budget.spend(MAX_BYTES + 100 * file_bytes - 10)
        return budget

    monkeypatch.setattr(bag_reader, "FileBudget", nearly_spent)
    with BagReader(bag) as reader:
        (last,) = reader.readable_messages("/points")
    assert "expands to more than" in str(last)


def test_records_before_a_message_are_counted_again_for_each_message(tmp_path):
    connection = ros1_record(7, conn=u32(0), topic=b"/points")
    bag = ros1_with_index(tmp_path / "bag.bag", connection * 300_000 + ros1_message(0), 50)
    with BagReader(bag) as reader:
        *_, last = reader.readable_messages("/points")
    assert "counting 1024 for each of" in str(last)


def test_an_index_that_is_named_again_and_again_is_refused(tmp_path):
    bag = ros1_with_index(tmp_path / "bag.bag", ros1_message(0), 4000)
    data = bag.read_bytes()
    info = data[data.rindex(b"chunk_pos=") - 100 :]
    info = info[info.index(u32(4) + b"op=\x06") - 4 :]
    many = data.replace(b"chunk_count=" + u32(1), b"chunk_count=" + u32(40)) + info * 39
    bag.write_bytes(many)
    with (
        pytest.raises(RecordingError, match="names more messages than there can be"),
        BagReader(bag),
    ):
        pass


def test_profiles_are_looked_at_once_for_each_channel(tmp_path, monkeypatch):
    texts = []
    monkeypatch.setattr(mcap_file, "has_latched_profile", lambda text: texts.append(text) or False)
    file = tiny_bags.write_unindexed_mcap(tmp_path / "bag.mcap")
    assert sum(topic.count for topic in inspect_recording(file).topics.values()) > len(texts)
    assert texts


def test_topics_read_side_by_side_do_not_expand_chunks_again(tmp_path):
    bag = ros1_in_turn(tmp_path / "bag.bag", 12 * MEBIBYTE, ("/one", "/two"))
    with BagReader(bag) as reader:
        scans = [reader.raw_messages(topic) for topic in ("/one", "/two")]
        assert len(list(zip(*scans, strict=True))) == 45
