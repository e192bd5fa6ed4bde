# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tiny recordings of every kind, written where a test wants them."""

import numpy as np
from bag_messages import cloud_cdr
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import encode_columns
from msg_utils.stamps import decode_stamp

JAZZY = get_typestore(Stores.ROS2_JAZZY)
NOETIC = get_typestore(Stores.ROS1_NOETIC)
FIRST_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
NUM_CLOUDS = 10
TOPIC = "/points"


def stamp(index):
    return FIRST_NS + index * STEP_NS


def xyz(index, num_points=50):
    return np.random.default_rng(index).normal(size=(num_points, 3)).astype(np.float32)


def encoded(points):
    return encode_columns(
        {name: points[:, axis] for axis, name in enumerate("xyz")}, 1, len(points)
    )


def cdr(index, num_points=50):
    return cloud_cdr(encoded(xyz(index, num_points)), stamp(index))


def write_ros2(path, plugin, mode=CompressionMode.NONE, *, indices=range(NUM_CLOUDS), size=50):
    """A rosbag2 folder of clouds; receive times are 5 ms behind the stamps."""
    writer = Ros2Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(TOPIC, CLOUD_TYPE, typestore=JAZZY)
        for index in indices:
            writer.write(connection, stamp(index) + 5_000_000, cdr(index, size))
    return path


def write_mcap(path, **options):
    return write_ros2(path, StoragePlugin.MCAP, **options)


def write_sqlite(path, **options):
    return write_ros2(path, StoragePlugin.SQLITE3, **options)


def write_ros1(path):
    with Ros1Writer(path) as writer:
        connection = writer.add_connection(TOPIC, CLOUD_TYPE, typestore=NOETIC)
        for index in range(NUM_CLOUDS):
            raw = JAZZY.cdr_to_ros1(cdr(index), CLOUD_TYPE)
            writer.write(connection, stamp(index) + 5_000_000, raw)
    return path


def write_unindexed_mcap(path, *, has_summary=False, metadata=None):
    """One mcap file without chunks and indexes.

    With a summary it is as the preset `fastwrite` of rosbag2 makes it. `metadata` is that of its
    channel.
    """
    definition, _ = JAZZY.generate_msgdef(CLOUD_TYPE, ros_version=2)
    with path.open("wb") as file:
        writer = McapWriter(
            file,
            compression=CompressionType.NONE,
            use_chunking=False,
            index_types=IndexType.NONE,
            use_statistics=has_summary,
            use_summary_offsets=False,
            repeat_schemas=has_summary,
            repeat_channels=has_summary,
        )
        writer.start("ros2", "test")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema, metadata or {})
        for index in range(NUM_CLOUDS):
            time = stamp(index) + 5_000_000
            writer.add_message(channel, time, bytes(cdr(index)), time)
        writer.finish()
    return path


def write_checked_mcap(
    path,
    compression=CompressionType.ZSTD,
    size=50,
    chunk_size=1,
    *,
    order=range(NUM_CLOUDS),
    num_publishers=1,
):
    """An mcap file as rosbag2 writes it: chunks with checksums, by default one for each cloud.

    Each publisher has a channel of its own, and they take turns.
    """
    definition, _ = JAZZY.generate_msgdef(CLOUD_TYPE, ros_version=2)
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=chunk_size, compression=compression)
        writer.start("ros2", "test")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", definition.encode())
        channels = [
            writer.register_channel(TOPIC, "cdr", schema, {"publisher": str(number)})
            for number in range(num_publishers)
        ]
        for index in order:
            time, channel = stamp(index) + 5_000_000, channels[index % num_publishers]
            writer.add_message(channel, time, bytes(cdr(index, size)), time)
        writer.finish()
    return path


def index_of(received):
    """The index of a cloud, of its receive time and message."""
    received_ns, message = received
    stamp_ns = decode_stamp(message.header.stamp)
    assert received_ns == stamp_ns + 5_000_000
    return (stamp_ns - FIRST_NS) // STEP_NS
