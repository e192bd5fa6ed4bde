# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import errno

import numpy as np
import pytest
import tiny_bags
from mcap.reader import make_reader
from mcap.records import SummaryOffset
from mcap.stream_reader import StreamReader
from mcap.writer import Writer as McapWriter

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import ODOMETRY_TYPE
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.storage_file import Damage
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import decode_xyz
from msg_utils.stamps import decode_stamp


def write_one(path, topic="/points", **options):
    with BagWriter(path, **options) as writer:
        writer.write_raw(topic, CLOUD_TYPE, 7, tiny_bags.cdr(0))


def write_and_fail(path, error, **options):
    with BagWriter(path, **options) as writer:
        writer.write_raw("/other", CLOUD_TYPE, 7, tiny_bags.cdr(0))
        raise error


def test_what_is_written_is_read(tmp_path):
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    pose[:3, 3] = [1.5, -2.5, 0.25]
    with BagWriter(tmp_path / "deep" / "bag") as writer:
        for index in range(3):
            points = tiny_bags.encoded(tiny_bags.xyz(index))
            writer.write_cloud("/points", points, tiny_bags.stamp(index), "lidar", is_dense=False)
            writer.write_odometry("/odom", pose, tiny_bags.stamp(index), "odom", "lidar")
    with BagReader(tmp_path / "deep" / "bag") as reader:
        assert {t: s.msgtype for t, s in reader.topics.items()} == {
            "/odom": ODOMETRY_TYPE,
            "/points": CLOUD_TYPE,
        }
        for index, (received_ns, message) in enumerate(reader.readable_messages("/points")):
            assert received_ns == decode_stamp(message.header.stamp) == tiny_bags.stamp(index)
            assert np.array_equal(decode_xyz(message)[0], tiny_bags.xyz(index))
            assert message.header.frame_id == "lidar"
            assert not message.is_dense
        message = next(reader.messages("/odom"))
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "lidar")
        assert message.pose.pose.position.y == -2.5
        assert message.pose.pose.orientation.z == pytest.approx(np.sqrt(0.5))


def test_is_compressed_and_numbered_without_offsets_of_empty_groups(tmp_path):
    with BagWriter(tmp_path / "bag.mcap") as writer:
        for index in range(3):
            for topic in ("/front", "/rear")[: index + 1]:
                writer.write_raw(topic, CLOUD_TYPE, index, tiny_bags.cdr(index))
    with (tmp_path / "bag.mcap").open("rb") as stream:
        reader = make_reader(stream)
        numbers = [(channel.topic, one.sequence) for _, channel, one in reader.iter_messages()]
        assert {chunk.compression for chunk in reader.get_summary().chunk_indexes} == {"zstd"}
        # pymcap-cli 0.34 objects to offsets of empty groups, which mcap 1.6.0 writes.
        stream.seek(0)
        records = StreamReader(stream, emit_chunks=True).records
        assert not any(isinstance(record, SummaryOffset) for record in records)
    assert numbers == [("/front", 1), ("/front", 2), ("/rear", 1), ("/front", 3), ("/rear", 2)]


def test_flipped_bits_in_what_was_written_are_noticed(tmp_path):
    bag = tmp_path / "bag"
    with BagWriter(bag) as writer:
        for index in range(10):
            # About 1.4 MB each: two of them make a chunk.
            points = tiny_bags.encoded(tiny_bags.xyz(index, 60_000))
            writer.write_cloud("/points", points, tiny_bags.stamp(index), "lidar")
    with BagReader(bag) as reader:
        assert reader.has_checksums
        assert reader.damages == ()
    with (bag / "bag.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 10
        chunks = reader.get_summary().chunk_indexes
    middle = chunks[2].chunk_start_offset + chunks[2].chunk_length // 2
    data = bytearray((bag / "bag.mcap").read_bytes())
    data[middle] ^= 1
    (bag / "bag.mcap").write_bytes(data)
    with BagReader(bag) as reader:
        found = list(reader.readable_messages("/points"))
    (damage,) = (one for one in found if isinstance(one, Damage))
    assert damage.position == f"byte {chunks[2].chunk_start_offset}"


def test_layout_is_that_of_rosbag2(tmp_path):
    write_one(tmp_path / "bag")
    assert sorted(file.name for file in (tmp_path / "bag").iterdir()) == [
        "bag.mcap",
        "metadata.yaml",
    ]
    assert "- bag.mcap" in (tmp_path / "bag" / "metadata.yaml").read_text()
    # The reference reader of the format, as other programs use it, agrees.
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        reader = make_reader(file)
        schema, channel, message = next(iter(reader.iter_messages()))
        assert reader.get_header().profile == "ros2"
    assert (schema.name, schema.encoding) == (CLOUD_TYPE, "ros2msg")
    assert (channel.topic, channel.message_encoding) == ("/points", "cdr")
    assert message.data == bytes(tiny_bags.cdr(0))
    assert (tmp_path / "bag").stat().st_mode & 0o055 == 0o055


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError])
def test_nothing_stays_after_an_exception(tmp_path, error):
    with pytest.raises(error, match="mine"):
        write_and_fail(tmp_path / "bag", error("mine"))
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_visible_before_the_end(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_raw("/points", CLOUD_TYPE, 0, tiny_bags.cdr(0))
        assert not (tmp_path / "bag").exists()
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]


def test_existing_recording_is_replaced_only_when_told(tmp_path):
    write_one(tmp_path / "bag")
    before = (tmp_path / "bag" / "bag.mcap").read_bytes()
    with pytest.raises(RecordingError, match="bag: exists already"):
        write_one(tmp_path / "bag")
    with pytest.raises(ValueError, match="mine"):
        write_and_fail(tmp_path / "bag", ValueError("mine"), overwrite=True)
    assert (tmp_path / "bag" / "bag.mcap").read_bytes() == before
    write_one(tmp_path / "bag", "/other", overwrite=True)
    with BagReader(tmp_path / "bag") as reader:
        assert list(reader.topics) == ["/other"]
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("kind", ["file", "folder with more", "folder in folder"])
def test_overwriting_spares_what_is_no_recording(tmp_path, kind):
    path = tmp_path / "precious"
    if kind == "file":
        path.write_text("thesis")
    else:
        write_one(path)
        (path / "thesis").mkdir() if "in" in kind else (path / "thesis").write_text("")
    with pytest.raises(RecordingError, match="precious: is not replaced"):
        write_one(path, overwrite=True)
    assert path.exists()


def test_a_single_file_holds_what_the_folder_would(tmp_path):
    write_one(tmp_path / "bag")
    write_one(tmp_path / "bag.mcap")
    assert (tmp_path / "bag.mcap").read_bytes() == (tmp_path / "bag" / "bag.mcap").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "bag.mcap"]


def test_full_disk(tmp_path, monkeypatch):
    def write(_writer, *_message):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(McapWriter, "add_message", write)
    with pytest.raises(RecordingError, match="cannot be written: No space left on device"):
        write_one(tmp_path / "bag")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("topic", "msgtype", "stamp_ns", "text"),
    [
        ("/points", ODOMETRY_TYPE, 0, f"'/points' holds {CLOUD_TYPE}, got {ODOMETRY_TYPE}"),
        ("/other", "my_msgs/msg/Unknown", 0, "'my_msgs/msg/Unknown' is unknown"),
        ("/points", CLOUD_TYPE, -1, "stamp is -1"),
    ],
)
def test_wrong_message_is_explained(tmp_path, topic, msgtype, stamp_ns, text):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_raw("/points", CLOUD_TYPE, 0, tiny_bags.cdr(0))
        with pytest.raises(RecordingError, match=text):
            writer.write_raw(topic, msgtype, stamp_ns, tiny_bags.cdr(0))


def test_recording_without_messages_is_not_made(tmp_path):
    with pytest.raises(RecordingError, match="nothing was written"), BagWriter(tmp_path / "bag"):
        pass
    assert list(tmp_path.iterdir()) == []
