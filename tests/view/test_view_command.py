# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf view`: a viewer receives coloured clouds."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("foxglove")
pytest.importorskip("websockets")

from rosbags.typesys import Stores, get_typestore
from viewer import Viewer

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.view.view_server import ViewServer
from msg_utils.point_cloud2 import decode_points

SMALL = SimulationSettings(num_beams=16, num_columns=360, duration_s=1.0)
FLOW = "/scene_flow/flow"
TYPES = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "street"
    write_recording(SMALL, path)
    return path


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "mnsf_ros.cli", "view", *arguments]


@contextmanager
def serving(*arguments: str) -> Iterator[str]:
    """The command, on a free port of this computer; where it serves."""
    with subprocess.Popen(
        command(*arguments, "--port", "0"), stderr=subprocess.PIPE, text=True
    ) as view:
        lines = []
        try:
            for line in view.stderr:
                lines.append(line)
                if match := re.match(r"serving +(ws://127.0.0.1:\d+)$", line):
                    yield match[1]
                    break
            else:
                raise AssertionError(lines)
        finally:
            view.kill()


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs the command and returns the one line that it ends with."""

    def run_refused(*arguments: str) -> str:
        assert run(["view", *arguments]) == EXIT_USAGE
        (line,) = capsys.readouterr().err.splitlines()
        return line

    return run_refused


def test_a_recording_is_seen_coloured(street: Path) -> None:
    others = ("/tf", "/scene_flow/objects/scene", "/scene_flow/debug/processing_time_ms")
    with serving(str(street), "--loop") as url, Viewer(url) as viewer:
        viewer.until(
            lambda it: len(it.messages[FLOW]) >= 3 and all(it.messages[name] for name in others)
        )
    schemas = {channel["topic"]: channel["schemaName"] for channel in viewer.channels.values()}
    assert schemas[FLOW] == "sensor_msgs/msg/PointCloud2"
    assert schemas["/scene_flow/objects/scene"] == "foxglove.SceneUpdate"
    assert schemas["/tf"] == "foxglove.FrameTransform"
    for time_ns, raw in viewer.messages[FLOW][:3]:
        cloud = TYPES.deserialize_cdr(raw, "sensor_msgs/msg/PointCloud2")
        assert cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec == time_ns
        points = decode_points(cloud).ravel()
        colors = points["rgb"].copy().view(np.uint32)
        moving = points["dynamic"] == 1
        assert moving.any()
        neutral = np.unique(colors[points["speed"] == 0])
        assert len(neutral) == 1
        assert (colors[moving] != neutral).mean() > 0.95
    ((_, milliseconds), *_) = viewer.messages["/scene_flow/debug/processing_time_ms"]
    assert TYPES.deserialize_cdr(milliseconds, "std_msgs/msg/Float64").data > 0


def test_what_is_left_of_a_recording_is_seen(street: Path, tmp_path: Path) -> None:
    (whole,) = street.glob("*.mcap")
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    with serving(str(cut), "--loop") as url, Viewer(url) as viewer:
        viewer.until(lambda it: len(it.messages[FLOW]) >= 3)


def test_what_cannot_be_shown_is_one_line(
    street: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    with BagWriter(tmp_path / "empty") as writer:
        empty = TYPES.types["std_msgs/msg/String"](data="no cloud")
        raw = bytes(TYPES.serialize_cdr(empty, "std_msgs/msg/String"))
        writer.write_raw("/words", "std_msgs/msg/String", 1, raw)
    assert "no topic of type sensor_msgs/msg/PointCloud2" in refused(str(tmp_path / "empty"))
    assert "nothing" in refused(str(tmp_path / "nothing"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert f"cannot serve on 127.0.0.1:{port}" in refused(str(street), "--port", port)
    assert "cannot serve on 127.0.0.1:99999" in refused(str(street), "--port", "99999")


def test_an_address_of_ipv6_has_brackets() -> None:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        pytest.skip("needs IPv6")
    with ViewServer().listening("::1", 0) as addresses:
        assert re.fullmatch(r"ws://\[::1\]:\d+", addresses.url)


def test_without_foxglove_it_says_what_to_install(
    street: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    assert "pip install '.[view]'" in refused(str(street))


def test_topics_of_a_node_are_handed_on_while_somebody_looks(own_domain: None) -> None:
    pytest.importorskip("rclpy")
    from std_msgs.msg import Float64

    from mnsf_ros.node.raw_topics import RawTopics

    with RawTopics("node_of_the_test") as ros:
        publisher = ros.publisher("/front/debug/processing_time_ms", "std_msgs/msg/Float64")
        with serving("--node", "/front") as url:
            with Viewer(url) as viewer:

                def is_heard(it: Viewer) -> bool:
                    publisher.publish(Float64(data=42.0))
                    topics = {channel["topic"] for channel in viewer.channels.values()}
                    return (
                        bool(it.messages["/front/debug/processing_time_ms"])
                        and {"/front/flow", "/front/objects/markers", "/diagnostics"} <= topics
                    )

                viewer.until(is_heard)
            give_up_s = time.monotonic() + 300
            while time.monotonic() < give_up_s:
                ros.spin_for(0.1)
                if publisher.get_subscription_count() == 0:
                    return
    raise AssertionError("it still listens to what nobody looks at")
