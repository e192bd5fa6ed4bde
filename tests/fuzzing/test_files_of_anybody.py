# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Damaged and made-up files of every format: what is read, or one line that says why not."""

from __future__ import annotations

import importlib.util
import warnings
from contextlib import closing

import apsw
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.errors import RecordingError, SweepFileError
from mnsf_ros.recording.bag_messages import cloud_message
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.read_sweep import read_sweep
from msg_utils.point_cloud2 import encode_columns

pytestmark = pytest.mark.slow
XYZ = np.arange(12, dtype=np.float32).reshape(4, 3)
PCD = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA {}\n"
)
ROWS = "\n".join(" ".join(map(str, row)) for row in XYZ.tolist()).encode() + b"\n"
# Where, how much is taken away, and what is put there instead.
EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 40), st.binary(max_size=9)), min_size=1, max_size=4
)
# The same, but what follows keeps its place: pages of a database would fit no more.
IN_PLACE = st.lists(
    st.builds(
        lambda place, new: (place, len(new), new),
        st.floats(0, 1),
        st.binary(min_size=1, max_size=9),
    ),
    min_size=1,
    max_size=4,
)
JAZZY, NOETIC = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
NUM_MESSAGES = 4


def edited(content, edits):
    for share, num_bytes, new in edits:
        place = round(share * len(content))
        content = content[:place] + new + content[place + num_bytes :]
    return content


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory):
    """A small sweep in each format, by its name."""
    folder = tmp_path_factory.mktemp("sweeps")
    np.save(folder / "sweep.npy", XYZ)
    np.savez_compressed(folder / "sweep.npz", xyz=XYZ)
    (folder / "sweep.bin").write_bytes(np.hstack([XYZ, XYZ[:, :1]]).tobytes())
    contents = {
        "ascii.pcd": PCD.format("ascii").encode() + ROWS,
        "binary.pcd": PCD.format("binary").encode() + XYZ.tobytes(),
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    if importlib.util.find_spec("pyarrow"):
        from pyarrow import Table, feather

        table = Table.from_arrays([XYZ[:, axis] for axis in range(3)], names=["x", "y", "z"])
        feather.write_feather(table, folder / "sweep.feather")
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


@given(st.data())
def test_a_damaged_sweep_is_read_or_refused_in_one_line(sweeps, tmp_path_factory, data):
    name = data.draw(st.sampled_from(sorted(sweeps)))
    file = tmp_path_factory.getbasetemp() / name
    file.write_bytes(edited(sweeps[name], data.draw(EDITS)))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            found = read_sweep(str(file))
    except SweepFileError as error:
        assert "\n" not in str(error)
    else:
        assert found.xyz.ndim == 2 or isinstance(found, Sweep)


def write_mcap(file):
    definition, _ = JAZZY.generate_msgdef(CLOUD_TYPE, ros_version=2)
    with file.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.NONE, chunk_size=900)
        writer.start("ros2", "test")
        schema = writer.register_schema(CLOUD_TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel("/points", "cdr", schema)
        for number in range(NUM_MESSAGES):
            raw = bytes(JAZZY.serialize_cdr(message(number), CLOUD_TYPE))
            writer.add_message(channel, number + 1, raw, number + 1)
        writer.finish()


def write_ros1(file):
    with Ros1Writer(file) as writer:
        connection = writer.add_connection("/points", CLOUD_TYPE, typestore=NOETIC)
        for number in range(NUM_MESSAGES):
            raw = JAZZY.cdr_to_ros1(
                bytes(JAZZY.serialize_cdr(message(number), CLOUD_TYPE)), CLOUD_TYPE
            )
            writer.write(connection, number + 1, raw)


def write_sqlite(file):
    """With small pages, so that the tables have several."""
    with closing(apsw.Connection(str(file))) as database:
        list(
            database.execute(
                """PRAGMA page_size = 512;
                CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
                INSERT INTO schema VALUES (3, 'humble');
                CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,
                    serialization_format TEXT, offered_qos_profiles TEXT);
                CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
                    data BLOB);
                CREATE INDEX timestamp_idx ON messages (timestamp ASC);"""
            )
        )
        topic = (1, "/points", CLOUD_TYPE, "cdr", "")
        database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", topic)
        raw = bytes(JAZZY.serialize_cdr(message(0), CLOUD_TYPE))
        rows = [(number + 1, 1, number, raw) for number in range(NUM_MESSAGES)]
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)


def message(number):
    encoded = encode_columns({name: XYZ[:, axis] for axis, name in enumerate("xyz")}, 1, len(XYZ))
    return cloud_message(encoded, number + 1, "lidar", is_dense=True)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_mcap(folder / "bag.mcap")
    write_ros1(folder / "bag.bag")
    write_sqlite(folder / "bag.db3")
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


@given(st.data())
def test_a_damaged_recording_is_read_or_refused_in_one_line(bags, tmp_path_factory, data):
    name = data.draw(st.sampled_from(sorted(bags)))
    file = tmp_path_factory.getbasetemp() / name
    file.write_bytes(edited(bags[name], data.draw(EDITS | IN_PLACE)))
    try:
        inspection = inspect_recording(file)
        with inspection.open() as reader:
            for topic in reader.topics:
                for item in reader.readable_messages(topic):
                    assert not isinstance(item, Damage) or "\n" not in str(item)
    except RecordingError as error:
        assert "\n" not in str(error)
