# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording is published as it was recorded."""

from __future__ import annotations

import functools
import itertools
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.demo import play as play_module
from mnsf_ros.demo.play import PlayOptions, in_time, play
from mnsf_ros.node.raw_topics import MessageTypeError, RawTopics, message_class
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.bag_writer import BagWriter

TOPICS = ("/points", "/truth/odometry")


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


class Graph:
    """A ROS graph in which waiting takes no time; it keeps what is published, and when."""

    now_s = 0.0
    heard_from_s = 0.0

    def __init__(self) -> None:
        self.published: list[tuple[float, str, bytes]] = []
        self.told_ns: list[int] = []

    def __enter__(self) -> Graph:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def publisher(self, topic: str, msgtype: str, *, is_latched: bool):
        message_class(msgtype)
        return type(
            "Publisher",
            (),
            {"publish": lambda _, raw: self.published.append((self.now_s, topic, bytes(raw)))},
        )()

    def clock(self):
        return self.told_ns.append

    def num_subscribers(self, topic: str) -> int:
        return int(topic == "/points" and self.now_s >= self.heard_from_s)

    def spin_for(self, duration_s: float) -> None:
        self.now_s += max(0.0, duration_s)


@pytest.fixture
def graph(monkeypatch) -> Graph:
    graph = Graph()
    monkeypatch.setattr(play_module, "RawTopics", lambda _: graph)
    timed = functools.partial(in_time, clock=lambda: graph.now_s)
    monkeypatch.setattr(play_module, "in_time", timed)
    return graph


class Enough(Exception):  # noqa: N818 - it ends a loop
    pass


def test_messages_come_in_order_at_their_times_with_a_clock(street: Path, graph: Graph) -> None:
    left_out: list[str] = []
    with BagReader(street) as reader:
        play(reader, PlayOptions(rate=2.0, clock=True), lambda _: None, left_out.append)
    (text,) = left_out
    assert text == "/tf is left out: the message type tf2_msgs/msg/TFMessage is not installed"
    start_s = graph.published[0][0]
    start_ns = min(stored(street, topic)[0][0] for topic in TOPICS)
    for topic in TOPICS:
        heard = [(now_s, raw) for now_s, name, raw in graph.published if name == topic]
        due_s = [start_s + (time_ns - start_ns) / 2e9 for time_ns, _ in stored(street, topic)]
        assert [now_s for now_s, _ in heard] == pytest.approx(due_s)
        assert [raw for _, raw in heard] == [raw for _, raw in stored(street, topic)]
    assert graph.told_ns == sorted(graph.told_ns)
    assert {time_ns for time_ns, _ in stored(street, "/points")} < set(graph.told_ns)
    steps_ns = [after - before for before, after in itertools.pairwise(graph.told_ns)]
    assert max(steps_ns) <= 100_000_001


def test_topics_are_chosen_and_repeated(street: Path, graph: Graph) -> None:
    points = [raw for _, raw in stored(street, "/points")]

    def on_message(number: int) -> None:
        if number == 2 * len(points):
            raise Enough

    options = PlayOptions(topics=("/points",), loop=True)
    with BagReader(street) as reader, pytest.raises(Enough):
        play(reader, options, on_message, pytest.fail)
    assert [(topic, raw) for _, topic, raw in graph.published] == [
        ("/points", raw) for raw in 2 * points
    ]
    assert graph.told_ns == []


def test_the_first_message_waits_for_somebody_who_listens(street: Path, graph: Graph) -> None:
    graph.heard_from_s = 20.0
    with BagReader(street) as reader:
        play(reader, PlayOptions(wait=True), lambda _: None, lambda _: None)
    assert graph.published[0][0] == 20.0


def test_the_command_is_heard_over_the_real_middleware(street: Path, own_domain: None) -> None:
    points = [raw for _, raw in stored(street, "/points")]
    heard: list[bytes] = []

    def is_round() -> bool:
        """Whether a round is whole; both ends may find each other late. DDS pads messages."""
        return any(
            all(map(bytes.startswith, heard[start : start + len(points)], points))
            for start in range(len(heard) - len(points) + 1)
        )

    command = [sys.executable, "-m", "mnsf_ros.cli", "play", str(street), "--loop", "--rate", "2"]
    with (
        RawTopics("listener") as ros,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
    ):
        ros.subscribe("/points", CLOUD_TYPE, heard.append, depth=1000)
        give_up_s = time.monotonic() + 120
        while not is_round() and process.poll() is None and time.monotonic() < give_up_s:
            ros.spin_for(0.05)
        process.terminate()
        _, said = process.communicate()
    assert is_round(), said
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--topics", "/tf"], "no topic can be published"),
        (["--topics", "/points,/nothing"], "no topic '/nothing'"),
    ],
)
def test_invalid_arguments_are_refused(
    street: Path, own_domain: None, capsys, arguments: list[str], words: str
) -> None:
    assert run(["play", str(street), *arguments]) == EXIT_USAGE
    assert words in capsys.readouterr().err.splitlines()[-1]


def test_an_invalid_rate_is_refused(capsys) -> None:
    with pytest.raises(SystemExit, match="2"):
        run(["play", "street", "--rate", "nan"])
    assert "expected 0.01 to 100" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["os/msg/Path", "x", "../msg/A", "std_msgs/msg/numpy"])
def test_types_of_hostile_recordings_are_not_installed(name: str) -> None:
    with pytest.raises(MessageTypeError, match="is not installed"):
        message_class(name)
