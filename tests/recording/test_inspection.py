# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What can still be read of damaged recordings, and what is said about the rest."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import sys
from pathlib import Path

import pytest
import tiny_bags
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE, TopicSummary
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.inspection import inspect_recording, open_recording
from mnsf_ros.recording.mcap_parts import read_summary
from mnsf_ros.recording.salvage.salvage_reader import SalvageReader
from msg_utils.stamps import decode_stamp

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ALL = list(range(tiny_bags.NUM_CLOUDS))
# A cloud of so many points fills a chunk of its own.
LARGE = 90_000
LOST = "lost"


def write_checked_mcap(
    path, compression=CompressionType.ZSTD, size=200, chunk_size=1, *, order=ALL
):
    """An mcap file as rosbag2 writes it: chunks with checksums."""
    definition, _ = tiny_bags.JAZZY.generate_msgdef(CLOUD_TYPE, ros_version=2)
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=chunk_size, compression=compression)
        writer.start("ros2", "test")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel("/points", "cdr", schema)
        for index in order:
            time = tiny_bags.stamp(index) + 5_000_000
            writer.add_message(channel, time, bytes(tiny_bags.cdr(index, size)), time)
        writer.finish()
    return path


def read(path):
    """Index of each cloud, and LOST wherever some may be missing."""
    inspection = inspect_recording(path)
    with inspection.open() as reader:
        return [_index(item) for item in reader.readable_messages("/points")], inspection


def _index(item):
    if isinstance(item, Damage):
        return LOST
    received_ns, message = item
    stamp_ns = decode_stamp(message.header.stamp)
    assert received_ns == stamp_ns + 5_000_000
    return (stamp_ns - tiny_bags.FIRST_NS) // tiny_bags.STEP_NS


def flip(path, position):
    data = bytearray(path.read_bytes())
    data[position] ^= 0xFF
    path.write_bytes(data)


def cut(path, share):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


@pytest.mark.parametrize(
    "write",
    [
        tiny_bags.write_mcap,
        tiny_bags.write_sqlite,
        lambda path: tiny_bags.write_mcap(path, mode=CompressionMode.STORAGE),
        lambda path: tiny_bags.write_mcap(path, mode=CompressionMode.FILE),
        lambda path: tiny_bags.write_mcap(path, mode=CompressionMode.MESSAGE),
        lambda path: tiny_bags.write_mcap(path, mode=CompressionMode.MESSAGE) / "bag.mcap",
        lambda path: tiny_bags.write_sqlite(path, mode=CompressionMode.MESSAGE),
        lambda path: tiny_bags.write_sqlite(path, mode=CompressionMode.FILE),
        lambda path: tiny_bags.write_ros1(path.with_suffix(".bag")),
        lambda path: tiny_bags.write_unindexed_mcap(path.with_suffix(".mcap")),
        lambda path: write_checked_mcap(path.with_suffix(".mcap")),
        lambda path: write_checked_mcap(path.with_suffix(".mcap"), CompressionType.LZ4),
        lambda path: write_checked_mcap(path.with_suffix(".mcap"), CompressionType.NONE, 50, 2000),
    ],
)
def test_whole_recordings_are_read_whole(tmp_path, write):
    found, inspection = read(write(tmp_path / "bag"))
    assert found == ALL
    assert inspection.damages == ()
    assert inspection.topics == {"/points": TopicSummary(CLOUD_TYPE, 10)}


def test_damaged_message_that_was_compressed_by_itself_costs_nothing_else(tmp_path):
    bag = tiny_bags.write_mcap(tmp_path / "bag", mode=CompressionMode.MESSAGE)
    data = (bag / "bag.mcap").read_bytes()
    frame = zstd.compress(bytes(tiny_bags.cdr(4)))
    # The four bytes after magic and descriptor are the size that the frame claims.
    position = data.index(frame) + 5
    flip(bag / "bag.mcap", position)
    found, _ = read(bag)
    assert found == [LOST if index == 4 else index for index in ALL]


def test_only_chunks_with_checksums_are_safe_from_flipped_bits(tmp_path):
    assert inspect_recording(write_checked_mcap(tmp_path / "a.mcap")).has_checksums
    assert not inspect_recording(tiny_bags.write_mcap(tmp_path / "b")).has_checksums
    assert not inspect_recording(tiny_bags.write_sqlite(tmp_path / "c")).has_checksums
    assert not inspect_recording(tiny_bags.write_unindexed_mcap(tmp_path / "d.mcap")).has_checksums


@pytest.mark.parametrize("share", [0.25, 0.5, 0.999])
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_mcap_that_was_cut_short_is_read_up_to_the_cut(tmp_path, share, mode):
    bag = tiny_bags.write_mcap(tmp_path / "bag", size=LARGE, mode=mode)
    file = bag / "bag.mcap"
    cut(file, share)
    found, inspection = read(bag)
    whole = [index for index in found if index != LOST]
    assert whole == ALL[: len(whole)]
    assert abs(len(whole) - 10 * share) <= 1
    assert inspection.topics["/points"].count == len(whole)
    (damage,) = inspection.damages
    assert damage.position.startswith("byte ") or share > 0.9
    assert "cut short" in str(damage)
    # The same without its folder.
    assert read(file)[0] == found


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_whole_messages_of_a_chunk_that_is_cut_are_read(tmp_path, mode):
    # Ten clouds make one chunk.
    bag = tiny_bags.write_mcap(tmp_path / "bag", mode=mode, size=5000)
    cut(bag / "bag.mcap", 0.5)
    found, _ = read(bag)
    assert found[-1] == LOST
    whole = found[:-1]
    assert whole == ALL[: len(whole)]
    assert len(whole) >= 3


def test_damaged_chunk_is_left_out_and_its_place_told(tmp_path):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    chunk = read_summary(file).chunk_offsets[4]
    flip(file, chunk + 300)
    found, inspection = read(file)
    assert found == [0, 1, 2, 3, LOST, 5, 6, 7, 8, 9]
    (damage,) = inspection.damages
    assert damage.position == f"byte {chunk}"
    assert "damaged chunk" in damage.text


def test_reader_finds_its_way_back_after_a_damaged_length(tmp_path):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    chunk = read_summary(file).chunk_offsets[3]
    # The length of the record: its highest byte makes it longer than any file.
    flip(file, chunk + 8)
    found, inspection = read(file)
    assert found == [0, 1, 2, LOST, 4, 5, 6, 7, 8, 9]
    assert inspection.damages[0].position == f"byte {chunk}"


def test_chunk_that_turned_into_something_else_is_missed(tmp_path):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    chunk = read_summary(file).chunk_offsets[3]
    data = bytearray(file.read_bytes())
    data[chunk] = 0x0C  # metadata: without the index it would just be skipped
    file.write_bytes(data)
    assert read(file)[0] == [0, 1, 2, LOST, 4, 5, 6, 7, 8, 9]


def test_lost_first_chunk_does_not_cost_the_others(tmp_path):
    # Only the first chunk tells what the channel is; the index has a copy.
    file = write_checked_mcap(tmp_path / "bag.mcap")
    flip(file, read_summary(file).chunk_offsets[0] + 150)
    assert read(file)[0] == [LOST, 1, 2, 3, 4, 5, 6, 7, 8, 9]


def test_damaged_index_costs_nothing(tmp_path):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    flip(file, len(file.read_bytes()) - 200)
    found, inspection = read(file)
    assert found == ALL
    assert len(inspection.damages) <= 1


def test_metadata_that_cannot_be_read_costs_nothing(tmp_path):
    bag = tiny_bags.write_mcap(tmp_path / "bag")
    (bag / "metadata.yaml").write_text("relative_file_paths: [")
    found, inspection = read(bag)
    assert found == ALL
    assert "YAML" in str(inspection.damages[0])


def test_missing_file_of_a_split_recording_is_told(tmp_path):
    bag = tiny_bags.write_mcap(tmp_path / "bag")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(text.replace("- bag.mcap", "- bag.mcap\n  - bag_1.mcap"))
    found, inspection = read(bag)
    assert found == ALL
    assert "bag_1.mcap" in str(inspection.damages[0])


@pytest.mark.parametrize("has_summary", [False, True])
@pytest.mark.parametrize("promised", [10, 11])
def test_files_without_an_index_are_those_of_metadata(tmp_path, promised, has_summary):
    """That they have no index is no damage; another number of messages is."""
    bag = tiny_bags.write_mcap(tmp_path / "bag")
    tiny_bags.write_unindexed_mcap(bag / "bag.mcap", has_summary=has_summary)
    shutil.copy(bag / "bag.mcap", bag / "bag_copy.mcap")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text().replace("message_count: 10", f"message_count: {promised}")
    metadata.write_text(text)
    found, inspection = read(bag)
    assert found == ALL
    told = f"{metadata}: promises 11 messages on '/points', 10 are stored"
    assert list(map(str, inspection.damages)) == ([told] if promised != len(ALL) else [])


def test_compressed_file_without_an_index_has_to_be_decompressed(tmp_path):
    bag = tiny_bags.write_mcap(tmp_path / "bag", mode=CompressionMode.FILE)
    (file,) = bag.glob("*.zstd")
    plain = tiny_bags.write_unindexed_mcap(tmp_path / "plain.mcap")
    file.write_bytes(zstd.compress(plain.read_bytes()))
    with pytest.raises(RecordingError, match="has no index of its messages; decompress its files"):
        inspect_recording(bag)


@pytest.mark.parametrize(
    "profiles", ["  durability: 1\n", "  durability: transient_local\n", "  durability: 2\n"]
)
def test_latched_topics_are_known_without_an_index(tmp_path, profiles):
    metadata = {"offered_qos_profiles": f"- history: 3\n  depth: 1\n{profiles}"}
    file = tiny_bags.write_unindexed_mcap(tmp_path / "bag.mcap", metadata=metadata)
    assert inspect_recording(file).topics["/points"].is_latched == ("2" not in profiles)


@pytest.mark.parametrize("latching", [0, 1])
def test_latched_topics_of_ros_1_are_known_without_an_index(tmp_path, latching):
    file = tmp_path / "bag.bag"
    with Ros1Writer(file) as writer:
        options = {"typestore": tiny_bags.NOETIC, "latching": latching}
        connection = writer.add_connection("/points", CLOUD_TYPE, **options)
        writer.write(connection, 1, bytes(60))
    cut(file, 0.95)
    assert inspect_recording(file).topics["/points"].is_latched == bool(latching)


def test_a_recording_is_opened_by_its_index_if_it_has_one(tmp_path):
    """A damaged chunk is found when it is read, and not before."""
    file = write_checked_mcap(tmp_path / "bag.mcap")
    flip(file, read_summary(file).chunk_offsets[5] + 300)
    with open_recording(file, pytest.fail) as reader:
        assert not isinstance(reader, SalvageReader)
        with pytest.raises(RecordingError, match="after 5 good messages"):
            list(reader.messages("/points"))


def test_a_recording_that_was_cut_short_is_opened_with_warnings(tmp_path):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    chunks = read_summary(file).chunk_offsets
    # The first one says what the channel is.
    for chunk in chunks[1:9]:
        flip(file, chunk + 300)
    cut(file, 0.95)
    warnings = []
    with open_recording(file, warnings.append) as reader:
        assert len(list(reader.messages("/points"))) == len(ALL) - 8
    assert f"{file}, byte {chunks[1]}: damaged chunk" in warnings[0]
    assert len(warnings) == 6
    assert warnings[-1] == f"{file}: and 3 more"


def test_split_files_are_read_in_the_order_of_time(tmp_path):
    for name, indices in (("z", range(5)), ("a", range(5, 10))):
        tiny_bags.write_mcap(tmp_path / name, indices=indices)
    bag = tmp_path / "bag"
    bag.mkdir()
    for name in ("z", "a"):
        shutil.copy(tmp_path / name / f"{name}.mcap", bag)
    assert read(bag)[0] == ALL


@pytest.mark.parametrize("chunk_size", [1, 10_000])
def test_sweeps_are_not_mixed_where_the_clock_of_the_recorder_jumped_back(tmp_path, chunk_size):
    order = [0, 1, 2, 6, 7, 8, 9, 3, 4, 5]
    file = write_checked_mcap(tmp_path / "bag.mcap", chunk_size=chunk_size, order=order)
    assert read(file)[0] == order


def test_files_are_read_in_the_order_of_time_whatever_metadata_says(tmp_path):
    bag = tiny_bags.write_mcap(tmp_path / "bag", indices=range(5))
    later = tiny_bags.write_mcap(tmp_path / "later", indices=range(5, 10))
    (later / "later.mcap").rename(bag / "later.mcap")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text().replace("- bag.mcap", "- later.mcap\n  - bag.mcap")
    metadata.write_text(text)
    with BagReader(bag) as reader:
        found = [_index(item) for item in reader.received_messages("/points")]
    assert found == ALL


def test_files_that_do_not_belong_to_the_recording_are_left_alone(tmp_path):
    bag = tiny_bags.write_mcap(tmp_path / "bag")
    shutil.copy(bag / "bag.mcap", bag / "bag_copy.mcap")
    found, inspection = read(bag)
    assert found == ALL
    assert not inspection.damages


def test_mcap_of_another_recorder_is_no_damage(tmp_path):
    file = tmp_path / "log.mcap"
    definition, _ = tiny_bags.JAZZY.generate_msgdef(CLOUD_TYPE, ros_version=2)
    with file.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start("", "some other recorder")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel("/points", "cdr", schema)
        other = writer.register_channel("/notes", "json", 0)
        writer.add_message(other, 1, b"{}", 1)
        for index in ALL:
            time = tiny_bags.stamp(index) + 5_000_000
            writer.add_message(channel, time, bytes(tiny_bags.cdr(index)), time)
        writer.finish()
    found, inspection = read(file)
    assert found == ALL
    assert not inspection.damages
    assert list(inspection.topics) == ["/points"]


def test_damaged_message_in_sqlite_costs_nothing_else(tmp_path):
    path = tiny_bags.write_sqlite(tmp_path / "bag", mode=CompressionMode.MESSAGE, size=400)
    file = path / "bag.db3"
    data = file.read_bytes()
    start_of_compressed = b"\x28\xb5\x2f\xfd"
    assert data.count(start_of_compressed) == 10
    file.write_bytes(data.replace(start_of_compressed, b"rubb", 1))
    found, inspection = read(path)
    # SQLite puts messages where there is room: the one that is damaged may be any.
    lost = found.index(LOST)
    assert found == [LOST if index == lost else index for index in ALL]
    assert inspection.damages == ()


@pytest.mark.parametrize("write", [tiny_bags.write_sqlite, tiny_bags.write_mcap])
def test_other_number_of_messages_than_metadata_promises_is_told(tmp_path, write):
    metadata = write(tmp_path / "bag") / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 10", "message_count: 11"))
    found, inspection = read(metadata.parent)
    assert found == ALL
    (damage,) = inspection.damages
    assert str(damage) == f"{metadata}: promises 11 messages on '/points', 10 are stored"


@pytest.mark.parametrize(
    ("change", "text", "lost"),
    [
        ("DELETE FROM messages WHERE id = 4", "promises 10 messages on '/points', 9 are", {3}),
        ("UPDATE messages SET topic_id = 7 WHERE id = 4", "that belong to no topic: 1", {3}),
    ],
)
def test_rows_lost_from_sqlite_are_told(tmp_path, change, text, lost):
    path = tiny_bags.write_sqlite(tmp_path / "bag")
    with contextlib.closing(sqlite3.connect(path / "bag.db3")) as database:
        database.execute(change)
        database.commit()
    found, inspection = read(path)
    assert found == [index for index in ALL if index not in lost]
    assert text in " ".join(map(str, inspection.damages))


def test_damaged_index_of_sqlite_is_told(tmp_path):
    """The index of the times has lost a row: messages would come without it."""
    file = tiny_bags.write_sqlite(tmp_path / "bag", size=400) / "bag.db3"
    with contextlib.closing(sqlite3.connect(file)) as database:
        query = "SELECT rootpage FROM sqlite_master WHERE type = 'index'"
        ((page,),) = database.execute(query).fetchall()
        ((page_size,),) = database.execute("PRAGMA page_size").fetchall()
    data = bytearray(file.read_bytes())
    number_of_cells = (page - 1) * page_size + 3
    data[number_of_cells : number_of_cells + 2] = (9).to_bytes(2, "big")
    file.write_bytes(data)
    damages = inspect_recording(file).damages
    assert "the database is damaged: " in " ".join(map(str, damages))


def test_index_of_a_ros1_bag_that_mixes_up_topics_is_not_used(tmp_path):
    """The index says of a message of another topic that it is one of the sweeps."""
    file = tmp_path / "bag.bag"
    with Ros1Writer(file) as writer:
        connections = [
            writer.add_connection(topic, CLOUD_TYPE, typestore=tiny_bags.NOETIC)
            for topic in ("/points", "/others")
        ]
        for index in ALL:
            raw = tiny_bags.JAZZY.cdr_to_ros1(tiny_bags.cdr(index, LARGE), CLOUD_TYPE)
            time = tiny_bags.stamp(index) + 5_000_000
            writer.write(connections[int(index == 4)], time, raw)
    data = file.read_bytes()
    index_record, other = b"op=\x04", b"conn=" + connections[1].id.to_bytes(4, "little")
    places = [place for place in range(len(data)) if data.startswith(index_record, place)]
    (place,) = [place for place in places if other in data[place - 20 : place + 60]]
    start = data.index(other, place - 20)
    wrong = b"conn=" + connections[0].id.to_bytes(4, "little")
    file.write_bytes(data[:start] + wrong + data[start + len(wrong) :])
    found, inspection = read(file)
    assert found == [index for index in ALL if index != 4]
    told = " ".join(map(str, inspection.damages))
    assert "promises 10 messages on '/points', 9 are stored" in told


@pytest.mark.parametrize("content", [b"", b"x", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"\x00" * 500])
def test_nothing_to_read_is_an_error_in_one_line(tmp_path, content):
    path = tmp_path / "bag.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        inspect_recording(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere", "nowhere.mcap", "empty"])
def test_missing_recordings(tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=name):
        inspect_recording(tmp_path / name)


def test_file_that_vanishes_is_damage(tmp_path):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    inspection = inspect_recording(file)
    file.unlink()
    with inspection.open() as reader:
        (damage,) = reader.readable_messages("/points")
    assert "No such file" in str(damage)


@pytest.mark.parametrize("is_damaged", [False, True])
def test_salvage_reader_is_a_reader(tmp_path, is_damaged):
    file = write_checked_mcap(tmp_path / "bag.mcap")
    if is_damaged:
        flip(file, read_summary(file).chunk_offsets[5] + 300)
    with inspect_recording(file).open() as reader:
        assert isinstance(reader, SalvageReader) == is_damaged
        assert reader.find_topic(None, CLOUD_TYPE) == "/points"
        raw = list(
            reader.raw_messages("/points", start_ns=tiny_bags.stamp(2), stop_ns=tiny_bags.stamp(4))
        )
        assert [received for received, _ in raw] == [tiny_bags.stamp(i) + 5_000_000 for i in (2, 3)]
        assert raw[0][1] == bytes(tiny_bags.cdr(2, 200))
        assert len(list(reader.messages("/points", start_ns=tiny_bags.stamp(8)))) == 2
        with pytest.raises(RecordingError, match="no topic '/lidar'"):
            reader.raw_messages("/lidar")


def test_damage_is_one_line():
    assert str(Damage("a.mcap", "byte 7", "cut")) == "a.mcap, byte 7: cut"
    assert str(Damage(str(Path("a")), "", "cut")) == "a: cut"


@pytest.fixture(scope="module", params=[None, *Ros1Writer.CompressionFormat])
def ros1_bag(request, tmp_path_factory):
    file = tmp_path_factory.mktemp("ros1") / "bag.bag"
    writer = Ros1Writer(file)
    if request.param is not None:
        writer.set_compression(request.param)
    with writer:
        connection = writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.NOETIC)
        for index in ALL:
            raw = tiny_bags.JAZZY.cdr_to_ros1(tiny_bags.cdr(index, LARGE), CLOUD_TYPE)
            writer.write(connection, tiny_bags.stamp(index) + 5_000_000, raw)
    return file


@pytest.mark.parametrize("share", [0.3, 0.6, 0.999])
def test_ros1_bag_that_was_cut_short_is_read_up_to_the_cut(tmp_path, ros1_bag, share):
    file = tmp_path / "bag.bag"
    shutil.copy(ros1_bag, file)
    cut(file, share)
    found, inspection = read(file)
    whole = [index for index in found if index != LOST]
    assert whole == ALL[: len(whole)]
    assert abs(len(whole) - 10 * share) <= 1.5
    assert inspection.topics["/points"] == TopicSummary(CLOUD_TYPE, len(whole))
    (damage,) = inspection.damages
    assert damage.position.startswith("byte ")
    assert "cut short" in str(damage)
    assert not inspection.has_checksums


def test_ros1_bag_that_is_none_is_refused(tmp_path):
    file = tiny_bags.write_ros1(tmp_path / "bag.bag")
    file.write_bytes(b"#ROSBAG V1.2\n" + file.read_bytes()[13:])
    with pytest.raises(RecordingError, match="cannot be read"):
        inspect_recording(file)


def test_ros1_bag_that_was_never_closed_is_read_to_its_end(tmp_path):
    file = tiny_bags.write_ros1(tmp_path / "bag.bag")
    data = bytearray(file.read_bytes())
    place = data.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(data[place : place + 8], "little")
    data[place : place + 8] = bytes(8)
    file.write_bytes(data[:index])
    found, inspection = read(file)
    assert found == ALL
    (damage,) = inspection.damages
    assert "is not indexed" in str(damage)
    assert "rosbag reindex" in str(damage)


def test_inspection_tells_how_much_it_has_read(tmp_path):
    """Bytes rise from the first file to the last, and stay below all there are."""
    for number in range(2):
        tiny_bags.write_mcap(
            tmp_path / f"part_{number}", indices=range(40 * number, 40 * number + 40)
        )
    folder = tmp_path / "both"
    folder.mkdir()
    for file in sorted(tmp_path.glob("part_*/*.mcap")):
        file.rename(folder / file.name)
    told = []
    inspection = inspect_recording(folder, lambda done, total: told.append((done, total)))
    size = sum(file.stat().st_size for file in folder.iterdir())
    assert len(told) == sum(summary.count for summary in inspection.topics.values()) > 0
    assert {total for _, total in told} == {size}
    done = [number for number, _ in told]
    assert done == sorted(done)
    assert done[0] < size / 4 < size / 2 < done[-1] < size
