# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording is published as it was recorded."""

import itertools
import struct
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.node.play import in_time, play
from mnsf_ros.node.raw_topics import MessageTypeError, RawTopics, message_class
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import ODOMETRY_TYPE
from mnsf_ros.recording.bag_writer import BagWriter
from msg_utils.other_clouds import CLOUD_TYPE

TOPICS = ("/points", "/truth/odometry")
AFTER_STAMP = 12


@pytest.fixture(scope="module")
def street(make_street, tmp_path_factory) -> Path:
    """With a message of a type that is not installed beside its own."""
    path = tmp_path_factory.mktemp("recording") / "street"
    with BagReader(make_street()) as reader, BagWriter(path) as writer:
        for topic, summary in reader.topics.items():
            for time_ns, raw in reader.raw_messages(topic):
                writer.write_raw(topic, summary.msgtype, time_ns, raw)
        writer.write_raw("/tf", "tf2_msgs/msg/TFMessage", time_ns, bytes(8))
    return path


def stored(recording: Path, topic: str) -> list[tuple[int, bytes]]:
    """Times and messages of a topic."""
    with BagReader(recording) as reader:
        return [(time_ns, bytes(raw)) for time_ns, raw in reader.raw_messages(topic)]


def stamp_of(raw: bytes) -> tuple[int, int]:
    """Seconds and nanoseconds of a serialized message that begins with a header."""
    return struct.unpack_from("<iI", raw, 4)


def listen(ros: RawTopics, topic: str, msgtype: str, heard: list[bytes]) -> None:
    """Collects the messages of a topic, serialized; a player may be faster than its listener."""
    ros.node.create_subscription(message_class(msgtype), topic, heard.append, 1000, raw=True)


def test_messages_are_due_at_their_times_and_a_clock_runs_on_between_them() -> None:
    now_s, told_ns, due = 5.0, [], []

    def wait(duration_s: float) -> None:
        nonlocal now_s
        now_s += duration_s

    messages = [(time_ns,) for time_ns in (10**9, 11 * 10**8, 11 * 10**8, 2 * 10**9)]
    for (time_ns,) in in_time(messages, wait, 2.0, told_ns.append, lambda: now_s):
        due.append(now_s)
        assert told_ns[-1] == time_ns
    assert due == pytest.approx([5.0, 5.05, 5.05, 5.5])
    steps_ns = [after - before for before, after in itertools.pairwise(told_ns)]
    assert 0 <= min(steps_ns) <= max(steps_ns) <= 100_000_001


def test_topics_are_chosen_and_the_first_message_waits_for_somebody_who_listens(
    street: Path, own_domain: None
) -> None:
    points = [raw for _, raw in stored(street, "/points")]
    left_out: list[str] = []
    heard: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}

    def run_play() -> None:
        with BagReader(street) as reader:
            play(reader, lambda _: None, left_out.append, topics=("/points", "/tf"), wait=True)

    player = Thread(target=run_play, daemon=True)
    player.start()
    with RawTopics("listener") as ros:
        # Longer than the recording lasts.
        ros.spin_for(2.0)
        for topic, msgtype in zip(TOPICS, (CLOUD_TYPE, ODOMETRY_TYPE), strict=True):
            listen(ros, topic, msgtype, heard[topic])
        give_up_s = time.monotonic() + 120
        while player.is_alive() and time.monotonic() < give_up_s:
            ros.spin_for(0.05)
    # DDS pads messages; the first ones may come before both ends have found each other.
    assert 0 < len(heard["/points"]) <= len(points)
    assert all(map(bytes.startswith, reversed(heard["/points"]), reversed(points)))
    assert heard["/truth/odometry"] == []
    assert left_out == ["/tf is left out: the message type tf2_msgs/msg/TFMessage is not installed"]


def test_the_command_is_heard_over_the_real_middleware(street: Path, own_domain: None) -> None:
    points = [raw[AFTER_STAMP:] for _, raw in stored(street, "/points")]
    heard: list[bytes] = []

    def is_round() -> bool:
        """Whether two rounds are whole; both ends may find each other late. DDS pads messages."""
        contents, two = [raw[AFTER_STAMP:] for raw in heard], [*points, *points]
        return any(
            all(map(bytes.startswith, contents[start : start + len(two)], two))
            for start in range(len(contents) - len(two) + 1)
        )

    topics = ",".join(TOPICS)
    command = [sys.executable, "-m", "mnsf_ros.cli", "play", street, "--topics", topics]
    command += ["--loop", "--rate", "4"]
    with (
        RawTopics("listener") as ros,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
    ):
        listen(ros, "/points", CLOUD_TYPE, heard)
        give_up_s = time.monotonic() + 120
        while not is_round() and process.poll() is None and time.monotonic() < give_up_s:
            ros.spin_for(0.05)
        process.terminate()
        _, said = process.communicate()
    assert is_round(), said
    assert process.returncode == 0
    stamps_s = [seconds + nanoseconds / 1e9 for seconds, nanoseconds in map(stamp_of, heard)]
    steps_s = np.diff(stamps_s)
    assert all(
        step == pytest.approx(0.1, abs=0.01) or step == pytest.approx(10) for step in steps_s
    )
    assert np.count_nonzero(steps_s > 1) >= 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--topics", "/tf"], "no topic can be published"),
        (["--topics", "/points,/nothing"], "no topic '/nothing'"),
        (["--topics", ""], "no topic ''"),
    ],
)
def test_invalid_arguments_are_refused(
    street: Path, own_domain: None, capsys, arguments: list[str], words: str
) -> None:
    assert run(["play", str(street), *arguments]) == EXIT_USAGE
    assert words in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("name", ["os/msg/Path", "x", "../msg/A", "std_msgs/msg/numpy"])
def test_types_of_hostile_recordings_are_not_installed(name: str) -> None:
    with pytest.raises(MessageTypeError, match="is not installed"):
        message_class(name)
