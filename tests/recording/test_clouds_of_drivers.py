# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recordings with compressed clouds, those of Livox, or packets of a lidar."""

import numpy as np
import pytest
import tiny_bags
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import used_topics
from mnsf_ros.settings import TimeSettings
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from msg_utils.expansion import zstd_library
from msg_utils.other_clouds import CLOUD_TYPE, COMPRESSED_TYPE, DEFINITIONS, LIVOX_TYPES
from msg_utils.point_cloud2 import decode_points, decode_xyz

NUM = 100


def typestore(store):
    known = get_typestore(store)
    for name, definition in DEFINITIONS.items():
        known.register(get_types_from_msg(definition, name))
    return known


JAZZY, NOETIC = typestore(Stores.ROS2_JAZZY), typestore(Stores.ROS1_NOETIC)


def compressed(index, form="zstd", data=None):
    cloud = JAZZY.deserialize_cdr(tiny_bags.cdr(index, NUM), CLOUD_TYPE)
    data = zstd_library().compress(cloud.data.tobytes()) if data is None else data
    values = {name: getattr(cloud, name) for name in cloud.__dataclass_fields__ if name != "data"}
    del values["__msgtype__"]
    values["compressed_data"] = np.frombuffer(data, np.uint8)
    return JAZZY.types[COMPRESSED_TYPE](**values, format=form)


def livox(index, msgtype=LIVOX_TYPES[0], store=JAZZY, **more):
    types, package = store.types, msgtype.partition("/")[0]
    stamp = types["builtin_interfaces/msg/Time"](*divmod(tiny_bags.stamp(index), 10**9))
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="livox_frame", **more)
    point = types[f"{package}/msg/CustomPoint"]
    points = [point(i * 10**6, 1.0 + i, 2.0, 0.5, i, 16, i % 4) for i in range(NUM)]
    reserved = np.zeros(3, np.uint8)
    return types[msgtype](header, tiny_bags.stamp(index), NUM, 0, reserved, points)


def write(path, messages, topic="/points"):
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(topic, messages[0].__msgtype__, typestore=JAZZY)
        for index, message in enumerate(messages):
            raw = JAZZY.serialize_cdr(message, message.__msgtype__)
            writer.write(connection, tiny_bags.stamp(index), raw)
    return path


def clouds_of(path):
    with BagReader(path) as reader:
        topic = used_topics(path, reader.topics).points
        return list(reader.messages(topic))


def test_compressed_clouds_are_found_and_read_as_clouds(tmp_path):
    clouds = clouds_of(write(tmp_path / "bag", [compressed(index) for index in range(3)]))
    for index, cloud in enumerate(clouds):
        xyz, _ = decode_xyz(cloud)
        np.testing.assert_array_equal(xyz, tiny_bags.xyz(index, NUM))
    assert len(clouds) == 3


@pytest.mark.parametrize("msgtype", LIVOX_TYPES[:2])
def test_livox_clouds_have_the_times_of_their_points(tmp_path, msgtype):
    (cloud,) = clouds_of(write(tmp_path / "bag", [livox(0, msgtype)]))
    sweep = CloudReader().sweep(cloud, TimeSettings(), 0)
    assert (sweep.frame_id, sweep.stamp_ns) == ("livox_frame", tiny_bags.stamp(0))
    np.testing.assert_allclose(sweep.times_s, np.arange(NUM) * 1e-3, atol=1e-7)
    assert sweep.xyz[:, 0].tolist() == [1.0 + i for i in range(NUM)]


def test_livox_clouds_of_ros_1(tmp_path):
    msgtype = LIVOX_TYPES[2]
    with Ros1Writer(tmp_path / "livox.bag") as writer:
        connection = writer.add_connection("/livox/lidar", msgtype, typestore=NOETIC)
        raw = NOETIC.serialize_ros1(livox(0, msgtype, NOETIC, seq=1), msgtype)
        writer.write(connection, tiny_bags.stamp(0), raw)
    (cloud,) = clouds_of(tmp_path / "livox.bag")
    assert decode_points(cloud)["intensity"][0].tolist() == list(range(NUM))


def test_raw_clouds_are_taken_rather_than_compressed_ones(tmp_path):
    path = tmp_path / "bag"
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, message in (("/a/zstd", compressed(0)), ("/raw", None)):
            msgtype = CLOUD_TYPE if message is None else COMPRESSED_TYPE
            connection = writer.add_connection(topic, msgtype, typestore=JAZZY)
            raw = tiny_bags.cdr(0) if message is None else JAZZY.serialize_cdr(message, msgtype)
            writer.write(connection, 1, raw)
    with BagReader(path) as reader:
        assert used_topics(path, reader.topics).points == "/raw"
        assert used_topics(path, reader.topics, "/a/zstd").points == "/a/zstd"


def test_a_format_that_cannot_be_read_is_one_error_and_no_damage(tmp_path):
    path = write(tmp_path / "bag", [compressed(index, "draco") for index in range(3)])
    with pytest.raises(RecordingError, match="topic '/points': clouds of the format draco lose"):
        clouds_of(path)


def test_one_damaged_compressed_cloud_is_a_damage(tmp_path):
    messages = [compressed(0), compressed(1, data=b"\x28\xb5\x2f\xfd damaged"), compressed(2)]
    with BagReader(write(tmp_path / "bag", messages)) as reader:
        _, damage, _ = reader.readable_messages("/points")
    assert "message 2 on '/points' cannot be read: compressed data (zstd) is damaged" in str(damage)


def test_packets_are_told_what_makes_clouds_of_them(tmp_path):
    msgtype = "velodyne_msgs/msg/VelodyneScan"
    JAZZY.register(get_types_from_msg("std_msgs/Header header\n", msgtype))
    header = livox(0).header
    path = write(tmp_path / "bag", [JAZZY.types[msgtype](header)], "/velodyne_packets")
    expected = r"velodyne_transform_node of velodyne_pointcloud makes clouds of velodyne_msgs"
    with pytest.raises(RecordingError, match=expected):
        clouds_of(path)
