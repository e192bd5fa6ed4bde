# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording is published as it was recorded, by the real command over real DDS."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock

from mnsf_ros.demo.pace import Pace
from mnsf_ros.node.raw_topics import MessageTypeError, RawTopics, message_class
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

pytestmark = pytest.mark.usefixtures("own_domain")
SMALL = SimulationSettings(num_beams=16, num_columns=90, duration_s=1.5)
HEARD = {
    "/points": "sensor_msgs/msg/PointCloud2",
    "/truth/odometry": "nav_msgs/msg/Odometry",
    "/clock": "rosgraph_msgs/msg/Clock",
}


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a message of a type that is not installed beside its own."""
    folder = tmp_path_factory.mktemp("recording")
    write_recording(SMALL, folder / "plain")
    with BagReader(folder / "plain") as reader, BagWriter(folder / "street") as writer:
        for topic, summary in reader.topics.items():
            for time_ns, raw in reader.raw_messages(topic):
                writer.write_raw(topic, summary.msgtype, time_ns, raw)
        writer.write_raw("/tf", "tf2_msgs/msg/TFMessage", time_ns, bytes(8))
    return folder / "street"


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "mnsf_ros.cli", "play", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(play: subprocess.Popen[str]) -> tuple[int, str]:
    with play:
        _, stderr = play.communicate(timeout=300)
    return play.returncode, stderr


def heard_of(*arguments: str, until=lambda heard: False) -> tuple[dict[str, list[bytes]], str]:
    """What came on each topic, up to the end of the command or a condition."""
    heard: dict[str, list[bytes]] = {topic: [] for topic in HEARD}
    with RawTopics("listener") as ros:
        for topic, msgtype in HEARD.items():
            ros.subscribe(topic, msgtype, heard[topic].append, depth=1000)
        play = start(*arguments)
        give_up_s = time.monotonic() + 300
        while play.poll() is None and not until(heard):
            assert time.monotonic() < give_up_s
            ros.spin_for(0.05)
        play.kill()
        return heard, ended(play)[1]


def is_round_of(heard: list[bytes], stored: list[bytes]) -> bool:
    """Whether all stored messages came in order, without a gap, at least once.

    On a busy machine both ends may find each other late, and messages may be lost: tests listen
    until a round is whole. DDS pads to multiples of four bytes.
    """
    return any(
        all(map(bytes.startswith, heard[start : start + len(stored)], stored))
        for start in range(len(heard) - len(stored) + 1)
    )


def stored(recording: Path, topic: str) -> tuple[list[int], list[bytes]]:
    """Times and messages of a topic."""
    with BagReader(recording) as reader:
        messages = list(reader.raw_messages(topic))
    return [time_ns for time_ns, _ in messages], [bytes(raw) for _, raw in messages]


def clocks_ns(heard: dict[str, list[bytes]]) -> list[int]:
    clocks = [deserialize_message(raw, Clock).clock for raw in heard["/clock"]]
    return [clock.sec * 10**9 + clock.nanosec for clock in clocks]


def runs_of(clock_ns: list[int]) -> list[list[int]]:
    """The parts in which time does not go back."""
    starts = [0]
    starts += [i for i, pair in enumerate(itertools.pairwise(clock_ns), 1) if pair[1] < pair[0]]
    return [clock_ns[start:stop] for start, stop in zip(starts, [*starts[1:], None], strict=True)]


def test_messages_come_as_they_are_stored_and_at_their_times(street: Path) -> None:
    times_ns, points = stored(street, "/points")
    _, odometry = stored(street, "/truth/odometry")

    def is_whole(heard: dict[str, list[bytes]]) -> bool:
        if not is_round_of(heard["/points"], points):
            return False
        # How many rounds it takes until one is whole depends on the machine. Time goes on in it
        # from the first to the last message; then it goes back.
        *runs, _ = runs_of(clocks_ns(heard))
        return (
            is_round_of(heard["/truth/odometry"], odometry)
            and any(set(times_ns) <= set(run) for run in runs)
            and len(set().union(*runs)) > len(times_ns)
        )

    heard, said = heard_of(str(street), "--clock", "--rate", "2", "--loop", until=is_whole)
    assert is_whole(heard)
    told_ns = clocks_ns(heard)
    assert (min(told_ns), max(told_ns)) == (times_ns[0], times_ns[-1])
    assert "/tf is left out: the message type tf2_msgs/msg/TFMessage is not installed" in said


def test_topics_are_chosen_and_repeated(street: Path) -> None:
    arguments = ("--topics", "/points", str(street), "--loop", "--rate", "4")
    twice = 2 * stored(street, "/points")[1]
    heard, _ = heard_of(*arguments, until=lambda heard: is_round_of(heard["/points"], twice))
    assert is_round_of(heard["/points"], twice)
    assert heard["/truth/odometry"] == heard["/clock"] == []


def test_what_is_left_of_a_recording_is_played(street: Path, tmp_path: Path) -> None:
    (whole,) = street.glob("*.mcap")
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    with inspect_recording(cut).open() as reader:
        left = [bytes(raw) for _, raw in reader.raw_messages("/points")]
    assert len(left) >= 3
    arguments = (str(cut), "--topics", "/points", "--loop", "--rate", "4")
    heard, said = heard_of(*arguments, until=lambda heard: is_round_of(heard["/points"], left))
    assert is_round_of(heard["/points"], left)
    assert "cut.mcap, byte" in said
    assert "cut short" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--topics", "/tf"], "no topic can be published"),
        (["--topics", "/nothing"], "no topic '/nothing'"),
        (["--topics", "/points,/nothing"], "no topic '/nothing'"),
        (["--rate", "0"], "expected 0.01 to 100"),
        (["--rate", "nan"], "expected 0.01 to 100"),
    ],
)
def test_what_cannot_be_played_is_said(street: Path, arguments: list[str], words: str) -> None:
    status, said = ended(start(str(street), *arguments))
    assert status == 2
    assert words in said.splitlines()[-1]
    assert "Traceback" not in said


@pytest.mark.parametrize(
    "name", ["os/msg/Path", "x", "../msg/A", "std_msgs/msg/numpy", "sensor_msgs/msg/No"]
)
def test_types_of_hostile_recordings_are_not_installed(name: str) -> None:
    with pytest.raises(MessageTypeError, match="is not installed"):
        message_class(name)


def test_pace() -> None:
    now_s = [10.0]
    pace = Pace(2.0, lambda: now_s[0])
    assert pace.left_s(5_000_000_000) == 0
    assert pace.left_s(6_000_000_000) == pytest.approx(0.5)
    now_s[0] = 11.0
    assert pace.left_s(6_000_000_000) == pytest.approx(-0.5)
