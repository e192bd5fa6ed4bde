# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What can still be read of damaged recordings, and what is said about the rest."""

import contextlib
import os
import shutil
import sqlite3
import time

import pytest
import tiny_bags
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader, open_recording
from mnsf_ros.recording.storage_file import Damage
from msg_utils.other_clouds import CLOUD_TYPE

ALL = list(range(tiny_bags.NUM_CLOUDS))
# A cloud of so many points fills a chunk of its own.
LARGE = 90_000
LOST = "lost"


def read(path):
    """Index of each cloud, and LOST wherever some may be missing; and the reader."""
    with BagReader(path) as reader:
        return [
            LOST if isinstance(item, Damage) else tiny_bags.index_of(item)
            for item in reader.readable_messages("/points")
        ], reader


def assert_refused(path, text):
    with pytest.raises(RecordingError, match=text) as caught, BagReader(path):
        pass
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def flip(path, position):
    data = bytearray(path.read_bytes())
    data[position] ^= 0xFF
    path.write_bytes(data)


def cut(path, share=0.5):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def chunk_offsets(file):
    with file.open("rb") as stream:
        return [one.chunk_start_offset for one in make_reader(stream).get_summary().chunk_indexes]


def with_notes(path):
    (path / "notes.txt").write_text("hello")
    return path


def with_recordings(path):
    for name in ("one", "two"):
        tiny_bags.write_mcap(path / name)
    return path


def with_two_kinds(path):
    folder = tiny_bags.write_mcap(path / "bag")
    (folder / "metadata.yaml").unlink()
    shutil.copy(tiny_bags.write_sqlite(path / "other") / "other.db3", folder)
    return folder


def without_messages(path):
    with Ros2Writer(path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.JAZZY)
    return path / "bag"


def other_database(path):
    with contextlib.closing(sqlite3.connect(path / "notes.db3")) as connection:
        connection.execute("CREATE TABLE notes (text TEXT)")
        connection.commit()
    return path / "notes.db3"


def without_times(path):
    folder = tiny_bags.write_sqlite(path / "bag")
    with contextlib.closing(sqlite3.connect(folder / "bag.db3")) as database:
        database.executescript("UPDATE messages SET timestamp = 'now' WHERE id = 4")
    return folder


def pipe(path):
    """To open it would wait for ever."""
    os.mkfifo(path / "f.mcap")
    return path / "f.mcap"


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda path: path / "nowhere", "no such file or folder; expected a rosbag2 folder"),
        (with_notes, "holds no recording; expected a rosbag2 folder"),
        (with_recordings, "recordings in its subfolders, such as 'one': name one"),
        (with_two_kinds, "holds .db3 and .mcap files but no metadata.yaml; name one file"),
        (lambda path: with_notes(path) / "notes.txt", "is not a recording; expected"),
        (without_messages, "holds no messages"),
        (other_database, "cannot be read: no such table"),
        (without_times, "cannot be read: invalid literal for int"),
        (pipe, "'f.mcap' is not a regular file"),
    ],
)
def test_other_things_are_explained(tmp_path, make, text):
    assert_refused(make(tmp_path), text)


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag", ".mcap.zstd"])
@pytest.mark.parametrize(
    "content",
    [b"", b"x", b"garbage " * 500, b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(500)],
    ids=["empty", "byte", "garbage", "magic", "zeros"],
)
def test_garbage_is_refused_in_one_line(tmp_path, suffix, content):
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    assert_refused(path, "cannot be read: |holds no messages; .*cut short or damaged")


@pytest.mark.parametrize("share", [0.25, 0.5, 0.999])
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_mcap_that_was_cut_short_is_read_up_to_the_cut(tmp_path, share, mode):
    bag = tiny_bags.write_mcap(tmp_path / "bag", size=LARGE, mode=mode)
    cut(bag / "bag.mcap", share)
    found, reader = read(bag)
    whole = [index for index in found if index != LOST]
    assert whole == ALL[: len(whole)]
    assert abs(len(whole) - 10 * share) <= 1
    assert reader.topics["/points"].count == len(whole)
    assert "cut short" in str(reader.damages[0])
    if len(whole) < len(ALL):
        (damage, told) = reader.damages
        assert damage.position.startswith("byte ")
        assert f"promises 10 messages on '/points', {len(whole)} are stored" in str(told)
    # The same without its folder.
    assert read(bag / "bag.mcap")[0] == found


@pytest.mark.parametrize(
    ("write", "share", "text"),
    [
        (tiny_bags.write_sqlite, 0.5, "sqlite3 FILE .recover"),
        (lambda path: tiny_bags.write_ros1(path.with_suffix(".bag")), 0.95, "rosbag reindex"),
    ],
)
def test_a_tool_that_repairs_what_was_cut_short_is_named(tmp_path, write, share, text):
    path = write(tmp_path / "bag")
    cut(next(path.glob("*.db3")) if path.is_dir() else path, share)
    assert_refused(path, text)


def test_ros_1_bag_that_was_never_closed_names_the_tool_that_repairs_it(tmp_path):
    file = tiny_bags.write_ros1(tmp_path / "bag.bag")
    data = bytearray(file.read_bytes())
    place = data.index(b"index_pos=") + len(b"index_pos=")
    data[place : place + 8] = bytes(8)
    file.write_bytes(data)
    assert_refused(file, "Bag is not indexed.*'rosbag reindex' may save")


def test_damaged_chunk_is_left_out_and_its_place_told(tmp_path):
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap")
    chunk = chunk_offsets(file)[4]
    flip(file, chunk + 300)
    found, reader = read(file)
    assert found == [0, 1, 2, 3, LOST, 5, 6, 7, 8, 9]
    assert reader.has_checksums
    with reader:
        damages = [one for one in reader.readable_messages("/points") if isinstance(one, Damage)]
        assert str(damages[0]).startswith(f"{file}, byte {chunk}: damaged chunk: ")
        with pytest.raises(RecordingError, match=f"byte {chunk}: damaged chunk"):
            list(reader.messages("/points"))


# In the head of a chunk: its kind, the length of its record, its size, checksum and data.
@pytest.mark.parametrize("place", [0, 1, 8, 25, 32, 33, 150])
@pytest.mark.parametrize("number", [0, 3])
def test_no_damage_of_a_chunk_costs_another_one(tmp_path, place, number):
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap")
    flip(file, chunk_offsets(file)[number] + place)
    found, _ = read(file)
    # A wrong length that its reader does not need costs nothing.
    assert found.pop(number) in (LOST, number)
    assert found == [index for index in ALL if index != number]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_chunk_that_expands_to_more_than_it_claims_is_left_out(tmp_path, compression):
    """By the library of mcap the size that the compressed data claims is taken."""
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap", compression)
    data, chunk = bytearray(file.read_bytes()), chunk_offsets(file)[3]
    # Behind its kind, length, and two times.
    data[chunk + 25 : chunk + 33] = (500).to_bytes(8, "little")
    file.write_bytes(data)
    found, reader = read(file)
    assert found == [0, 1, 2, LOST, 4, 5, 6, 7, 8, 9]
    with reader, pytest.raises(RecordingError, match="it expands to more than 500 bytes"):
        list(reader.messages("/points"))


def test_checksum_that_was_erased_is_missed(tmp_path):
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap", CompressionType.NONE)
    data = bytearray(file.read_bytes())
    chunk = chunk_offsets(file)[3]
    data[chunk + 33 : chunk + 37] = bytes(4)
    file.write_bytes(data)
    assert read(file)[0] == [0, 1, 2, LOST, 4, 5, 6, 7, 8, 9]


def test_damaged_index_costs_nothing(tmp_path):
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap")
    flip(file, len(file.read_bytes()) - 200)
    found, reader = read(file)
    assert found == ALL
    (damage,) = reader.damages
    assert "no index that can be read: its checksum is wrong" in str(damage)
    assert not reader.has_checksums


def test_only_chunks_with_checksums_are_safe_from_flipped_bits(tmp_path):
    assert read(tiny_bags.write_checked_mcap(tmp_path / "a.mcap"))[1].has_checksums
    for unsafe in (
        tiny_bags.write_mcap(tmp_path / "b"),
        tiny_bags.write_sqlite(tmp_path / "c"),
        tiny_bags.write_ros1(tmp_path / "d.bag"),
        tiny_bags.write_unindexed_mcap(tmp_path / "e.mcap"),
    ):
        assert not read(unsafe)[1].has_checksums


def test_message_that_is_no_message_costs_nothing_else(tmp_path):
    with Ros2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.JAZZY)
        for index in range(3):
            raw = b"\x00\x01\x00\x00nonsense" if index == 1 else tiny_bags.cdr(index)
            writer.write(connection, tiny_bags.stamp(index) + 5_000_000, raw)
    assert read(tmp_path / "bag")[0] == [0, LOST, 2]


@pytest.mark.parametrize("write", [tiny_bags.write_sqlite, tiny_bags.write_mcap])
def test_damaged_message_that_was_compressed_by_itself_costs_nothing_else(tmp_path, write):
    bag = write(tmp_path / "bag", mode=CompressionMode.MESSAGE, size=200)
    (file,) = (one for one in bag.iterdir() if one.suffix in (".mcap", ".db3"))
    flip(file, file.read_bytes().index(b"\x28\xb5\x2f\xfd") + 5)
    found, _ = read(bag)
    # SQLite puts messages where there is room: the one that is damaged may be any.
    lost = found.index(LOST)
    assert found == [LOST if index == lost else index for index in ALL]


@pytest.mark.parametrize(
    ("change", "text", "lost"),
    [
        ("DELETE FROM messages WHERE id = 4", "promises 10 messages on '/points', 9 are", [3]),
        ("UPDATE messages SET topic_id = 7 WHERE id = 4", "that belong to no topic: 1", [3]),
        ("UPDATE messages SET data = 'text' WHERE id = 9", "", [8]),
        ("UPDATE messages SET data = 123456789012 WHERE id = 10", "", [9]),
        ("UPDATE topics SET type = 'my_msgs/msg/Unknown'", "", ALL),
    ],
)
def test_changed_rows_of_sqlite_are_told(tmp_path, change, text, lost):
    path = tiny_bags.write_sqlite(tmp_path / "bag")
    with contextlib.closing(sqlite3.connect(path / "bag.db3")) as database:
        database.executescript(change)
    found, reader = read(path)
    assert [index for index in found if index != LOST] == [i for i in ALL if i not in lost]
    assert text in " ".join(map(str, reader.damages))
    assert LOST in found or reader.damages


@pytest.fixture
def metadata(tmp_path):
    return tiny_bags.write_mcap(tmp_path / "bag") / "metadata.yaml"


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "\x00\x01",
        "[" * 5_000,
        "a: [",
        "!!python/object/apply:os.system [ls]",
    ],
    ids=["empty", "list", "binary", "deep", "cut", "object"],
)
def test_metadata_that_cannot_be_read_costs_nothing(metadata, content):
    metadata.write_text(content)
    found, reader = read(metadata.parent)
    assert found == ALL
    (damage,) = reader.damages
    assert str(damage).startswith(f"{metadata}: cannot be read: ")
    assert "\n" not in str(damage)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("message_count: 10", "message_count: 11", "promises 11 messages on '/points', 10 are"),
        ("message_count: 10", "message_count: ten", "invalid literal for int()"),
        ("name: /points", "name: /lines", "promises 10 messages on '/lines', 0 are stored"),
        ("- bag.mcap", "- bag.mcap\n  - bag_1.mcap", "bag_1.mcap: cannot be read: No such file"),
        ("- bag.mcap", "- [5]", "cannot be read: "),
        ("- bag.mcap", "- bag.mcap\n  - ./bag.mcap", ""),
        ("version: 9", "version: 9\n  note: 4 * 5 & 6", ""),
        ("version: 9", "version: 9\n  one: &name 1\n  two: &name 2", ""),
        ("relative_file_paths", "some_paths", "cannot be read: it has no 'relative_file_paths'"),
        (f"type: {CLOUD_TYPE}", "type: sensor_msgs/msg/Imu", ""),
        ("version: 9", "version: 99", ""),
    ],
)
def test_metadata_that_lies_is_told(metadata, old, new, told):
    content = metadata.read_text()
    assert old in content
    metadata.write_text(content.replace(old, new))
    found, reader = read(metadata.parent)
    assert found == ALL
    assert told in " ".join(map(str, reader.damages))
    assert bool(reader.damages) == bool(told)


def test_a_number_in_base_60_in_metadata_takes_no_time(metadata):
    """It has 400,000 digits."""
    number = "1" + 200_000 * ":1"
    metadata.write_text(f"%YAML 1.1\n---\n{metadata.read_text()}number: {number}\n")
    began_s = time.process_time()
    found, reader = read(metadata.parent)
    assert time.process_time() - began_s < 1.5
    assert found == ALL
    assert not reader.damages


@pytest.mark.parametrize("name", ["../other/other.mcap", "/etc/hostname", "..", "gone.mcap"])
def test_metadata_leads_to_no_file_outside_of_its_folder(metadata, name):
    tiny_bags.write_mcap(metadata.parents[1] / "other")
    metadata.write_text(metadata.read_text().replace("- bag.mcap", f"- {name}"))
    found, reader = read(metadata.parent)
    assert found == ALL
    (damage,) = reader.damages
    assert str(damage).startswith(f"{metadata}: names none of the files that are there")
    (metadata.parent / "bag.mcap").unlink()
    assert_refused(metadata.parent, "cannot be read: ")


def test_files_that_metadata_does_not_name_are_told(metadata):
    shutil.copy(metadata.parent / "bag.mcap", metadata.parent / "bag_1.mcap")
    found, reader = read(metadata.parent)
    assert found == ALL
    (damage,) = reader.damages
    assert str(damage).startswith(f"{metadata}, bag_1.mcap: does not name this file, which is not")


def test_changes_of_sqlite_that_were_not_completed_are_told(tmp_path):
    bag = tiny_bags.write_sqlite(tmp_path / "bag")
    (bag / "bag.db3-journal").write_bytes(b"journal")
    link = tmp_path / "link.db3"
    link.symlink_to(bag / "bag.db3")
    for path in (bag, link):
        assert "holds incomplete changes (-journal)" in str(read(path)[1].damages[0])


def test_a_recording_that_was_cut_short_is_opened_with_warnings(tmp_path):
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap")
    chunks = chunk_offsets(file)
    for chunk in chunks[1:9]:
        flip(file, chunk + 300)
    cut(file, 0.95)
    warnings = []
    with open_recording(file, warnings.append) as reader:
        assert len(list(reader.messages("/points"))) == len(ALL) - 8
    assert f"{file}, byte {chunks[1]}: damaged chunk" in warnings[0]
    assert len(warnings) == 6
    assert warnings[-1] == f"{file}: and 3 more"
