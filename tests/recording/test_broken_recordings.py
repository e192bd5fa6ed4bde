# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress
from itertools import pairwise

import numpy as np
import pytest
import tiny_bags
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.inspection import inspect_recording
from msg_utils.stamps import decode_stamp


def read_all(path):
    """Everything there is, as a user of the reader would go through it."""
    with BagReader(path) as reader:
        return {topic: list(reader.messages(topic)) for topic in reader.topics}


def assert_refused(path, text):
    with pytest.raises(RecordingError, match=text) as caught:
        read_all(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def cut(file, share=0.5):
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * share)])


def test_missing_path(tmp_path):
    assert_refused(tmp_path / "nowhere", "no such file or folder; expected a rosbag2 folder")


def test_empty_folder(tmp_path):
    assert_refused(tmp_path, "holds no recording; the folder is empty")


def test_folder_of_other_things(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    assert_refused(tmp_path, "holds no recording; it contains 'notes.txt'")


def test_folder_of_recordings(tmp_path):
    for name in ("one", "two"):
        tiny_bags.write_mcap(tmp_path / name)
    assert_refused(tmp_path, "recordings in its subfolders 'one', 'two': name one")


def test_folder_of_mixed_files(tmp_path):
    folder = tiny_bags.write_mcap(tmp_path / "bag")
    (folder / "metadata.yaml").unlink()
    shutil.copy(tiny_bags.write_sqlite(tmp_path / "other") / "other.db3", folder)
    assert_refused(folder, "holds .db3 and .mcap files but no metadata.yaml; name one file")


def test_other_file(tmp_path):
    (tmp_path / "cloud.pcd").write_text("VERSION 0.7")
    assert_refused(tmp_path / "cloud.pcd", "is not a recording; expected")


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
@pytest.mark.parametrize(
    "content", [b"", b"x", b"garbage " * 500], ids=["empty", "byte", "garbage"]
)
def test_garbage_file(tmp_path, suffix, content):
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    assert_refused(path, "cannot be read: ")


@pytest.mark.parametrize("name", ["f.mcap", "f.db3", "f.bag", "bag/bag.mcap"])
def test_named_pipe(tmp_path, name):
    """Opening one would wait for ever, deaf to signals: in a process that can be killed."""
    tiny_bags.write_mcap(tmp_path / "bag")
    pipe = tmp_path / name
    pipe.unlink(missing_ok=True)
    os.mkfifo(pipe)
    path = pipe if pipe.parent == tmp_path else pipe.parent
    command = [sys.executable, "-m", "mnsf_ros.cli", "evaluate", path, "--methods=zero"]
    command += ["--out", tmp_path / "out"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 2
    assert ended.stderr == f"mnsf: {path}: {pipe.name!r} is not a regular file\n"


@pytest.mark.parametrize("as_folder", [True, False])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.999])
def test_cut_mcap(tmp_path, as_folder, share):
    folder = tiny_bags.write_mcap(tmp_path / "bag")
    cut(folder / "bag.mcap", share)
    path = folder if as_folder else folder / "bag.mcap"
    assert_refused(path, "cannot be read: .*cut short; 'mcap recover'")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_cut_sqlite(tmp_path, share):
    folder = tiny_bags.write_sqlite(tmp_path / "bag", size=2000)
    cut(folder / "bag.db3", share)
    assert_refused(folder, "cannot be read|damaged after|could be read")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_cut_ros_1_bag(tmp_path, share):
    path = tiny_bags.write_ros1(tmp_path / "bag.bag")
    cut(path, share)
    assert_refused(path, "cannot be read: ")


def test_damaged_zstd_chunk_tells_how_far_it_got(tmp_path):
    # Chunks of rosbags are closed beyond 1 MiB: these clouds make one chunk each.
    folder = tiny_bags.write_mcap(tmp_path / "bag", mode=CompressionMode.STORAGE, size=90_000)
    file = folder / "bag.mcap"
    start_of_compressed = b"\x28\xb5\x2f\xfd"
    parts = file.read_bytes().split(start_of_compressed)
    assert len(parts) == 1 + tiny_bags.NUM_CLOUDS
    good, bad = start_of_compressed.join(parts[:6]), start_of_compressed.join(parts[6:])
    file.write_bytes(good + b"\x28\xb5\x2f\xff" + bad)
    with BagReader(folder) as reader:
        scan = reader.messages("/points")
        for index in range(5):
            assert decode_stamp(next(scan).header.stamp) == tiny_bags.stamp(index)
        with pytest.raises(
            RecordingError, match="damaged after 5 good messages on '/points': zstd"
        ):
            next(scan)


def test_cut_compressed_file(tmp_path):
    folder = tiny_bags.write_mcap(tmp_path / "bag", mode=CompressionMode.FILE)
    cut(folder / "bag.mcap.zstd")
    assert_refused(folder, "cannot be read: ")


def test_message_that_is_no_message(tmp_path):
    with Ros2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.JAZZY)
        for index in range(3):
            writer.write(connection, index, tiny_bags.cdr(index))
        writer.write(connection, 3, b"\x00\x01\x00\x00nonsense")
    assert_refused(tmp_path / "bag", "damaged after 3 good messages on '/points': .*PointCloud2")


def test_recording_without_messages(tmp_path):
    with Ros2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection("/points", CLOUD_TYPE, typestore=tiny_bags.JAZZY)
    assert_refused(tmp_path / "bag", "holds no messages")


def test_topic_without_messages(tmp_path):
    with Ros2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic in ("/points", "/empty"):
            connection = writer.add_connection(topic, CLOUD_TYPE, typestore=tiny_bags.JAZZY)
            if topic == "/points":
                writer.write(connection, 0, tiny_bags.cdr(0))
    with BagReader(tmp_path / "bag") as reader:
        assert reader.find_topic(None, CLOUD_TYPE) == "/points"
        assert list(reader.messages("/empty")) == []
        with pytest.raises(RecordingError, match="topic '/empty' holds no messages"):
            reader.find_topic("/empty", CLOUD_TYPE)


def test_mcap_of_another_world(tmp_path):
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros1", "test")
        writer.finish()
    assert_refused(tmp_path / "log.mcap", "cannot be read: Profile is not ros2")


@pytest.fixture
def metadata(tmp_path):
    return tiny_bags.write_mcap(tmp_path / "bag") / "metadata.yaml"


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("relative_file_paths:", "relative_file_paths: [", "metadata.yaml: .*YAML error"),
        ("relative_file_paths", "some_paths", "key .*relative_file_paths.* is missing"),
        ("- bag.mcap", "- gone.mcap", "files are missing.*gone.mcap"),
        ("version: 9", "version: 99", "version 99 not supported"),
        ("storage_identifier: mcap", "storage_identifier: tape", "Storage plugin 'tape'"),
        ("storage_identifier: mcap", "storage_identifier: sqlite3", "cannot be read: "),
        ("name: /points", "name: /lines", "does not list /points, which its files hold"),
        (CLOUD_TYPE, "sensor_msgs/msg/Imu", "0 of 10 messages on '/points'"),
    ],
)
def test_lying_metadata(metadata, old, new, text):
    content = metadata.read_text()
    assert old in content
    metadata.write_text(content.replace(old, new))
    assert_refused(metadata.parent, text)


@pytest.mark.parametrize("content", ["", "[]", "1", "rosbag2_bagfile_information: 3", "\x00\x01"])
def test_metadata_of_something_else(metadata, content):
    metadata.write_text(content)
    assert_refused(metadata.parent, "cannot be read: ")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("name: /points", "name: [/points]", r"topics_with_message_count\[0\].topic_metadata.name"),
        ("name: /points", "name: {a: 1}", r"topics_with_message_count\[0\].topic_metadata.name"),
        (f"type: {CLOUD_TYPE}", "type:", r"topics_with_message_count\[0\].topic_metadata.type"),
        (f"type: {CLOUD_TYPE}", "type: 2024-05-01", r"\[0\].topic_metadata.type"),
        (f"type: {CLOUD_TYPE}", "type: !!binary aGFsbG8=", r"\[0\].topic_metadata.type"),
        ("files:\n", "files: text\n  x:\n", "files"),
        ("version: 9", "version: true", "version"),
        ("version: 9", "version: 9.5", "version"),
        ("version: 9", "version: -1", "version"),
        ("message_count: 10", f"message_count: 0x{5000 * 'f'}", "message_count"),
        ("nanoseconds: ", f"nanoseconds: {2**63} #", "duration.nanoseconds"),
        ("- bag.mcap", "- 5", r"relative_file_paths\[0\]"),
        ("compression_mode: ''", "compression_mode: [zstd]", "compression_mode"),
    ],
)
def test_metadata_of_another_type_names_the_key(metadata, old, new, key):
    content = metadata.read_text()
    assert old in content
    metadata.write_text(content.replace(old, new))
    assert_refused(metadata.parent, f"metadata.yaml: .*'rosbag2_bagfile_information.*{key}'")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("custom_data: null", "custom_data: [1, 2]"),
        ("ros_distro: rosbags", "ros_distro: 9.5"),
        ("path: bag.mcap", "path: {a: 1}"),
        ("compression_format: ''", "compression_format: null"),
    ],
)
def test_what_nobody_reads_in_metadata_may_be_anything(metadata, old, new):
    content = metadata.read_text()
    assert old in content
    metadata.write_text(content.replace(old, new))
    assert len(read_all(metadata.parent)["/points"]) == tiny_bags.NUM_CLOUDS
    assert inspect_recording(metadata.parent).damages == ()


def test_metadata_has_a_limit(metadata):
    with metadata.open("a") as file:
        file.write("# " + "x" * 2**20)
    assert_refused(metadata.parent, f"larger than {2**20} bytes")


@pytest.mark.parametrize("name", ["../other/bag.mcap", "/etc/hostname", "..", "/"])
def test_metadata_leads_to_no_file_outside_of_its_folder(metadata, name):
    other = tiny_bags.write_mcap(metadata.parents[1] / "other", indices=range(3))
    assert (other / "bag.mcap").exists() or list(other.glob("*.mcap"))
    content = metadata.read_text()
    metadata.write_text(content.replace("- bag.mcap", f"- {name}"))
    (metadata.parent / "bag.mcap").unlink()
    with pytest.raises(RecordingError, match="cannot be read: "):
        read_all(metadata.parent)


MERGES = "a0: &a0 {x: 1}\n" + "".join(
    f"a{number}: &a{number} {{<<: [*a{number - 1}, *a{number - 1}]}}\n" for number in range(1, 30)
)
OPEN = """import sys
from mnsf_ros.recording.bag_reader import BagReader
with BagReader(sys.argv[1]):
    pass"""


INSPECT = """import sys
from mnsf_ros.recording.inspection import inspect_recording
inspect_recording(sys.argv[1])"""


def test_merge_keys_are_refused_before_they_are_read(metadata):
    """In a process that can be killed: each line doubles the time."""
    metadata.write_text(MERGES)
    command = [sys.executable, "-c", OPEN, metadata.parent]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert ended.stderr.endswith("line 2 has the merge key '<<', which is not supported\n")


@pytest.mark.parametrize("name", ["bag.mcap", "bag.db3", "bag"])
def test_merge_keys_in_the_profiles_of_a_topic_are_not_parsed(tmp_path, name):
    """They are YAML in a text, in each kind of file; only the durability is looked for."""
    file = tmp_path / name
    if name == "bag.mcap":
        tiny_bags.write_unindexed_mcap(
            file, has_summary=True, metadata={"offered_qos_profiles": MERGES}
        )
    else:
        folder = tiny_bags.write_sqlite(tmp_path / "bag")
        with closing(sqlite3.connect(folder / "bag.db3")) as database:
            database.execute("UPDATE topics SET offered_qos_profiles = ?", [MERGES])
            database.commit()
        file = folder / "bag.db3"
    if name == "bag":
        metadata = folder / "metadata.yaml"
        text = re.sub("offered_qos_profiles: .*", "offered_qos_profiles: 0", metadata.read_text())
        merges = json.dumps(MERGES)
        metadata.write_text(text.replace("profiles: 0", f"profiles: {merges}"))
        file = folder
    command = [sys.executable, "-c", INSPECT, file]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: {!!merge x: {y: 1}}", "merge key"),
        ("a: &a [*a]", "with its aliases it has more than 262144 values"),
        (f"a: &a [{1000 * '1,'}]\nb: [{1000 * '*a,'}]", "more than 262144 values"),
        ("[" * 51 + "]" * 51, "nested more than 50 levels deep"),
    ],
)
def test_metadata_that_grows_is_refused(metadata, text, reason):
    metadata.write_text(text)
    assert_refused(metadata.parent, f"metadata.yaml: cannot be read: .*{reason}")


def test_metadata_may_refer_to_what_it_has(metadata):
    """Python's writers do so for a table or list that occurs twice."""
    text = metadata.read_text()
    start = re.search(r"starting_time:\s+(nanoseconds_since_epoch: [0-9]+)", text)
    text = text.replace(start[0], "starting_time: *id001")
    metadata.write_text(text.replace("custom_data: null", f"custom_data: &id001 {{{start[1]}}}"))
    assert len(read_all(metadata.parent)["/points"]) == tiny_bags.NUM_CLOUDS


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x]\nb: &b [*a, *a, *a, *a, *a, *a, *a, *a, *a]\n"
        + "".join(
            f"{name}: &{name} [{', '.join(9 * ['*' + before])}]\n"
            for before, name in pairwise("bcdefghijklmnop")
        ),
        "[" * 100_000,
        "!!python/object/apply:os.system ['true']",
        "- " * 100_000,
    ],
)
def test_hostile_yaml_is_refused(metadata, text):
    """References that grow without end, nesting without end, and objects to be made."""
    metadata.write_text(text)
    assert_refused(metadata.parent, "metadata.yaml: cannot be read: ")


def test_lie_about_the_number_of_messages_does_no_harm(metadata):
    metadata.write_text(metadata.read_text().replace("message_count: 10", "message_count: 77"))
    with BagReader(metadata.parent) as reader:
        assert reader.topics["/points"].count == tiny_bags.NUM_CLOUDS
        assert len(list(reader.messages("/points"))) == tiny_bags.NUM_CLOUDS


def test_sqlite_of_something_else(tmp_path):
    connection = sqlite3.connect(tmp_path / "notes.db3")
    connection.execute("CREATE TABLE notes (text TEXT)")
    connection.commit()
    connection.close()
    assert_refused(tmp_path / "notes.db3", "cannot be read: .*missing tables")


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag", "zstd.mcap"])
def test_random_damage_gives_data_or_one_clear_error(tmp_path, kind):
    writers = {
        "mcap": lambda: tiny_bags.write_mcap(tmp_path / "bag") / "bag.mcap",
        "db3": lambda: tiny_bags.write_sqlite(tmp_path / "bag") / "bag.db3",
        "bag": lambda: tiny_bags.write_ros1(tmp_path / "bag.bag"),
        "zstd.mcap": lambda: (
            tiny_bags.write_mcap(tmp_path / "bag", mode=CompressionMode.STORAGE) / "bag.mcap"
        ),
    }
    path = writers[kind]()
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for trial in range(60):
        data = bytearray(whole)
        # Half of the damage goes to the ends, where headers and indexes are.
        low, high = (0, len(data)) if trial % 2 else (len(data) - 1500, len(data))
        for _ in range(int(rng.integers(1, 8))):
            data[int(rng.integers(low, high))] = int(rng.integers(256))
        path.write_bytes(data)
        with suppress(RecordingError):
            read_all(path)
            continue
        refused += 1
    assert refused > 5
