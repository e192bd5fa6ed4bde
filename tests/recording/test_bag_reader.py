# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import contextlib
import shutil
import sqlite3

import numpy as np
import pytest
import tiny_bags
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import get_types_from_msg

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader, open_recording
from mnsf_ros.recording.bag_topics import ODOMETRY_TYPE, TopicSummary, find_topic
from mnsf_ros.recording.bag_writer import BagWriter
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import decode_xyz
from msg_utils.stamps import decode_stamp


def without_metadata(folder):
    (folder / "metadata.yaml").unlink()
    return folder


def split(folder):
    """A folder without metadata.yaml whose files hold the two halves of the recording."""
    folder.mkdir()
    for part, indices in enumerate((range(5), range(5, 10))):
        made = tiny_bags.write_mcap(folder.parent / f"part_{part}", indices=indices)
        (made / f"part_{part}.mcap").rename(folder / f"split_{part}.mcap")
    return folder


KINDS = {
    "mcap folder": lambda p: tiny_bags.write_mcap(p / "bag"),
    "mcap zstd chunks": lambda p: tiny_bags.write_mcap(p / "bag", mode=CompressionMode.STORAGE),
    "mcap zstd file": lambda p: tiny_bags.write_mcap(p / "bag", mode=CompressionMode.FILE),
    "sqlite folder": lambda p: tiny_bags.write_sqlite(p / "bag"),
    "sqlite zstd messages": lambda p: tiny_bags.write_sqlite(
        p / "bag", mode=CompressionMode.MESSAGE
    ),
    "mcap zstd messages without metadata": lambda p: without_metadata(
        tiny_bags.write_mcap(p / "bag", mode=CompressionMode.MESSAGE)
    ),
    "sqlite zstd file": lambda p: tiny_bags.write_sqlite(p / "bag", mode=CompressionMode.FILE),
    "sqlite without metadata": lambda p: without_metadata(tiny_bags.write_sqlite(p / "bag")),
    "two mcap files": lambda p: split(p / "bag"),
    "mcap file": lambda p: tiny_bags.write_mcap(p / "bag") / "bag.mcap",
    "sqlite file": lambda p: tiny_bags.write_sqlite(p / "bag") / "bag.db3",
    "zstd file without metadata": lambda p: next(
        tiny_bags.write_mcap(p / "bag", mode=CompressionMode.FILE).glob("*.zstd")
    ),
    "mcap file with checksums": lambda p: tiny_bags.write_checked_mcap(p / "bag.mcap"),
    "mcap file, lz4": lambda p: tiny_bags.write_checked_mcap(p / "bag.mcap", CompressionType.LZ4),
    # Two channels of one topic: findings/pybag-two-publishers.sh has a reader that finds only one.
    "mcap file of two publishers": lambda p: tiny_bags.write_checked_mcap(
        p / "bag.mcap", num_publishers=2
    ),
    "unindexed mcap file": lambda p: tiny_bags.write_unindexed_mcap(p / "bag.mcap"),
    "unindexed mcap file with a summary": lambda p: tiny_bags.write_unindexed_mcap(
        p / "bag.mcap", has_summary=True
    ),
    "ros 1 file": lambda p: tiny_bags.write_ros1(p / "bag.bag"),
}


@pytest.fixture(scope="module", params=KINDS)
def recording(request, tmp_path_factory):
    return KINDS[request.param](tmp_path_factory.mktemp("recordings"))


def test_every_kind_gives_the_same_clouds(recording):
    with open_recording(str(recording), pytest.fail) as reader:
        assert reader.topics == {"/points": TopicSummary(CLOUD_TYPE, tiny_bags.NUM_CLOUDS)}
        assert reader.damages == ()
        assert find_topic(reader.path, reader.topics, None, CLOUD_TYPE) == "/points"
        assert find_topic(reader.path, reader.topics, "/points", CLOUD_TYPE) == "/points"
        messages = list(reader.messages("/points"))
        stored = list(reader.raw_messages("/points"))
        assert len(messages) == len(stored) == tiny_bags.NUM_CLOUDS
        for index, (message, (received_ns, raw)) in enumerate(zip(messages, stored, strict=True)):
            assert received_ns == tiny_bags.stamp(index) + 5_000_000
            assert raw == bytes(tiny_bags.cdr(index))
            assert decode_stamp(message.header.stamp) == tiny_bags.stamp(index)
            assert message.header.frame_id == "lidar"
            assert np.array_equal(decode_xyz(message)[0], tiny_bags.xyz(index))


def test_part_of_the_time(recording):
    with open_recording(recording, pytest.fail) as reader:
        messages = reader.since(tiny_bags.stamp(7)).messages("/points")
        assert [decode_stamp(m.header.stamp) for m in messages] == [
            tiny_bags.stamp(index) for index in (7, 8, 9)
        ]
        assert reader.span_ns == (tiny_bags.stamp(0) + 5_000_000, tiny_bags.stamp(9) + 5_000_000)


def test_scans_do_not_disturb_each_other(recording):
    with open_recording(recording, pytest.fail) as reader:
        slow = reader.raw_messages("/points")
        seen = []
        for _ in range(tiny_bags.NUM_CLOUDS):
            seen.append(next(slow)[1])
            assert len(list(reader.raw_messages("/points"))) == tiny_bags.NUM_CLOUDS
        assert seen == [bytes(tiny_bags.cdr(index)) for index in range(tiny_bags.NUM_CLOUDS)]


def test_file_without_messages_needs_no_index(tmp_path):
    """A recorder that splits may have begun a file before it ended."""
    bag = tiny_bags.write_mcap(tmp_path / "bag")
    with (bag / "last.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        writer.finish()
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("- bag.mcap", "- bag.mcap\n  - last.mcap"))
    with BagReader(bag) as reader:
        assert len(list(reader.messages("/points"))) == tiny_bags.NUM_CLOUDS


def test_error_of_the_caller_is_not_touched(tmp_path):
    def fail(_message):
        raise ValueError("mine")

    with (
        BagReader(tiny_bags.write_mcap(tmp_path / "bag")) as reader,
        pytest.raises(ValueError, match="mine"),
    ):
        list(map(fail, reader.messages("/points")))


def test_ros_1_type_without_equal_has_no_ros_2_bytes(tmp_path):
    types = get_types_from_msg("uint8 level", "my_msgs/msg/Battery")
    tiny_bags.NOETIC.register(types)
    with Ros1Writer(tmp_path / "bag.bag") as writer:
        connection = writer.add_connection(
            "/battery", "my_msgs/msg/Battery", typestore=tiny_bags.NOETIC
        )
        writer.write(connection, 1, b"\x2a")
    with (
        BagReader(tmp_path / "bag.bag") as reader,
        pytest.raises(RecordingError, match="my_msgs/msg/Battery has no equal in ROS 2"),
    ):
        next(reader.raw_messages("/battery"))


def two_topics(path):
    with BagWriter(path) as writer:
        for topic in ("/front", "/rear"):
            writer.write_raw(topic, CLOUD_TYPE, 5, tiny_bags.cdr(0))
        writer.write_odometry("/odom", np.eye(4), 5, "odom", "base_link")
    return path


@pytest.mark.parametrize(
    ("name", "msgtype", "text"),
    [
        (None, CLOUD_TYPE, f"2 topics of type {CLOUD_TYPE}: name one by --points: /front, /rear"),
        (None, "sensor_msgs/msg/Imu", "no topic of type sensor_msgs/msg/Imu; it has /front"),
        ("/left", CLOUD_TYPE, f"no topic '/left'; it has /front .{CLOUD_TYPE}., /odom .nav_msgs"),
        ("/odom", CLOUD_TYPE, f"'/odom' is of type {ODOMETRY_TYPE}, expected {CLOUD_TYPE}"),
    ],
)
def test_wrong_topic_is_explained(tmp_path, name, msgtype, text):
    with (
        BagReader(two_topics(tmp_path / "bag")) as reader,
        pytest.raises(RecordingError, match=text),
    ):
        find_topic(reader.path, reader.topics, name, msgtype)


LATCHED = Qos(
    *(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL),
    *(QosTime(0, 0), QosTime(0, 0), QosLiveliness.AUTOMATIC, QosTime(0, 0), False),
)


def write_profiles(path, plugin):
    with Ros2Writer(path, version=9, storage_plugin=plugin) as writer:
        for name, profiles in (("/plain", []), ("/latched", [LATCHED])):
            connection = writer.add_connection(
                name, CLOUD_TYPE, typestore=tiny_bags.JAZZY, offered_qos_profiles=profiles
            )
            writer.write(connection, 1, tiny_bags.cdr(0))


def write_latching(path):
    with Ros1Writer(path) as writer:
        for name, latching in (("/plain", 0), ("/latched", 1)):
            connection = writer.add_connection(
                name, CLOUD_TYPE, typestore=tiny_bags.NOETIC, latching=latching
            )
            writer.write(connection, 1, bytes(60))


@pytest.mark.parametrize(
    "write",
    [
        lambda path: write_profiles(path, StoragePlugin.MCAP),
        lambda path: write_profiles(path, StoragePlugin.SQLITE3),
        write_latching,
    ],
)
def test_latched_topics_are_known(tmp_path, write):
    write(tmp_path / "bag.bag")
    with BagReader(tmp_path / "bag.bag") as reader:
        latched = {name: summary.is_latched for name, summary in reader.topics.items()}
    assert latched == {"/plain": False, "/latched": True}


def test_mcap_of_another_recorder(tmp_path):
    """Its profile is not that of ROS 2, and a topic is not serialized as ROS 2 does."""
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = McapWriter(stream)
        writer.start("", "some other recorder")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", b"")
        writer.add_message(writer.register_channel("/notes", "json", 0), 1, b"{}", 1)
        channel = writer.register_channel("/points", "cdr", schema)
        writer.add_message(channel, 1, bytes(tiny_bags.cdr(0)), 1)
        writer.finish()
    with BagReader(tmp_path / "log.mcap") as reader:
        assert reader.topics["/notes"] == TopicSummary("", 1, encoding="json")
        with pytest.raises(RecordingError, match="topic '/notes' are json, expected"):
            reader.raw_messages("/notes")
        assert len(list(reader.messages("/points"))) == 1


def test_clouds_keep_the_order_of_the_file_where_the_clock_of_the_recorder_jumped_back(tmp_path):
    order = [0, 1, 2, 6, 7, 8, 9, 3, 4, 5]
    file = tiny_bags.write_checked_mcap(tmp_path / "bag.mcap", chunk_size=10_000, order=order)
    with BagReader(file) as reader:
        assert [tiny_bags.index_of(item) for item in reader.readable_messages("/points")] == order


@pytest.mark.parametrize(
    ("message_encoding", "name", "encoding", "told"),
    [
        ("protobuf", "foxglove.PointCloud", "protobuf", "/points (foxglove.PointCloud, protobuf)"),
        ("json", CLOUD_TYPE, "jsonschema", f"/points ({CLOUD_TYPE}, json)"),
        ("ros1", "sensor_msgs/PointCloud2", "ros1msg", "(sensor_msgs/PointCloud2, ros1)"),
        ("cdr", "foxglove::PointCloud", "omgidl", "(foxglove::PointCloud, cdr of omgidl)"),
    ],
)
def test_topics_of_other_encodings_are_listed(tmp_path, message_encoding, name, encoding, told):
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("", "some other recorder")
        schema = writer.register_schema(name, encoding, b"")
        channel = writer.register_channel("/points", message_encoding, schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(RecordingError) as caught, BagReader(tmp_path / "log.mcap"):
        pass
    assert "log.mcap: holds no messages; expected CDR of ROS 2, it has " in str(caught.value)
    assert told in str(caught.value)


def test_write_ahead_log_of_a_killed_recorder_is_read_and_stays(tmp_path):
    """As it leaves its files; findings/rosbags-write-ahead-log.sh has a reader that ignores it."""
    bag, left = tiny_bags.write_sqlite(tmp_path / "bag"), tmp_path / "left"
    with contextlib.closing(sqlite3.connect(bag / "bag.db3", isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("UPDATE messages SET timestamp = timestamp + 1")
        shutil.copytree(bag, left)
    (left / "bag.db3-shm").unlink()
    before = {file.name: file.read_bytes() for file in left.iterdir()}
    assert before["bag.db3-wal"]
    with open_recording(left, pytest.fail) as reader:
        times = [received_ns for received_ns, _ in reader.raw_messages("/points")]
    assert times == [tiny_bags.stamp(index) + 5_000_001 for index in range(tiny_bags.NUM_CLOUDS)]
    assert {file.name: file.read_bytes() for file in left.iterdir()} == before
