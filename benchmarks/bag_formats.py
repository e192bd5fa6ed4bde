# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small simulated recordings in each format that can be read, for `mutated_bags.py`."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

JAZZY = get_typestore(Stores.ROS2_JAZZY)
NOETIC = get_typestore(Stores.ROS1_NOETIC)
# Receive time, topic, type and CDR bytes.
Message = tuple[int, str, str, bytes]


def write_originals(folder: Path, settings: SimulationSettings | None = None) -> dict[str, Path]:
    """Writes one recording in each format; returns name -> the file to damage."""
    settings = settings or SimulationSettings(duration_s=0.6, num_beams=16, num_columns=48)
    folder.mkdir(parents=True)
    write_recording(settings, folder / "plain")
    write_recording(settings, folder / "compressed", compress=True)
    messages = list(_messages(folder / "plain"))
    files = {
        "mcap": folder / "plain" / "plain.mcap",
        "mcap zstd": folder / "compressed" / "compressed.mcap",
        "metadata.yaml": folder / "described" / "metadata.yaml",
    }
    shutil.copytree(folder / "plain", folder / "described")
    for name, compression in (("zstd", CompressionType.ZSTD), ("lz4", CompressionType.LZ4)):
        files[f"mcap {name} checked"] = folder / f"checked_{name}.mcap"
        _write_mcap(
            files[f"mcap {name} checked"], messages, compression=compression, chunk_size=8192
        )
    files["mcap checked"] = folder / "checked.mcap"
    plain = {"compression": CompressionType.NONE, "chunk_size": 8192}
    _write_mcap(files["mcap checked"], messages, **plain)
    files["mcap bare"] = folder / "bare.mcap"
    _write_mcap(files["mcap bare"], messages, use_chunking=False, index_types=IndexType.NONE)
    files["sqlite3"] = _write_ros2(folder / "sqlite", messages) / "sqlite.db3"
    files["ros1"] = _write_ros1(folder / "ros1.bag", messages)
    return files


def _messages(bag: Path) -> Iterator[Message]:
    with BagReader(bag) as reader:
        scans = {topic: reader.raw_messages(topic) for topic in reader.topics}
        found = [
            (received_ns, topic, reader.topics[topic].msgtype, raw)
            for topic, scan in scans.items()
            for received_ns, raw in scan
        ]
    yield from sorted(found, key=lambda message: message[:2])


def _write_mcap(file: Path, messages: Sequence[Message], **options: Any) -> None:  # noqa: ANN401
    with file.open("wb") as stream:
        writer = McapWriter(stream, **options)
        writer.start("ros2", "mutated_bags")
        channels = {}
        for received_ns, topic, msgtype, raw in messages:
            if topic not in channels:
                definition, _ = JAZZY.generate_msgdef(msgtype, ros_version=2)
                schema = writer.register_schema(msgtype, "ros2msg", definition.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], received_ns, bytes(raw), received_ns)
        writer.finish()


def _write_ros2(folder: Path, messages: Sequence[Message]) -> Path:
    with Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {}
        for received_ns, topic, msgtype, raw in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=JAZZY)
            writer.write(connections[topic], received_ns, bytes(raw))
    return folder


def _write_ros1(file: Path, messages: Sequence[Message]) -> Path:
    with Ros1Writer(file) as writer:
        connections = {}
        for received_ns, topic, msgtype, raw in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=NOETIC)
            writer.write(connections[topic], received_ns, JAZZY.cdr_to_ros1(bytes(raw), msgtype))
    return file
