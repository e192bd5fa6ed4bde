# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The demo with a small simulated street: the real node over real DDS."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from msg_utils.point_cloud2 import decode_points

# Slow enough that a loaded machine estimates at least one triplet before the recording ends.
SMALL = SimulationSettings(num_beams=16, num_columns=360, duration_s=2.0)


def start_demo(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = os.environ | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros_log"),
        "COLUMNS": "120",
    }
    return subprocess.Popen(
        [sys.executable, "-m", "mnsf_ros.cli", "demo", "--out", str(folder / "demo"), *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end_of(demo: subprocess.Popen[str]) -> subprocess.CompletedProcess[str]:
    with demo:
        stdout, stderr = demo.communicate(timeout=300)
    return subprocess.CompletedProcess(demo.args, demo.returncode, stdout, stderr)


def flows_and_more(folder: Path) -> dict[str, int]:
    with BagReader(folder / "demo" / "flow") as reader:
        return {topic: summary.count for topic, summary in reader.topics.items()}


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "street"
    write_recording(SMALL, path)
    return path


def test_demo_shows_records_and_draws_the_flow(street: Path, tmp_path: Path) -> None:
    done = end_of(start_demo(tmp_path, "--bag", str(street)))
    assert done.returncode == 0, done.stderr
    for words in ("sweeps in", "flows out", "dropped", "latency p95", "EPE (m)"):
        assert words in done.stdout
    for group in ("without ground", "- dynamic", "- static"):
        assert group in done.stdout
    picture = tmp_path / "demo" / "flow.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    with BagReader(tmp_path / "demo" / "flow") as reader:
        topic = reader.find_topic(None, CLOUD_TYPE)
        names = {field.name for field in next(reader.messages(topic)).fields}
        assert {"x", "y", "z", "intensity", "ring", "flow_x", "flow_y", "flow_z", "rgb"} <= names
        assert reader.topics["/scene_flow/objects/markers"].count > 0
        assert reader.topics["/diagnostics"].count > 0


@pytest.mark.slow
def test_two_demos_at_once_do_not_mix(street: Path, tmp_path: Path) -> None:
    """Of the same sweeps, at the same time: each has only the flows of its own node."""
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
    demos = [start_demo(folder, "--bag", str(street), "--points", "/points") for folder in folders]
    ends = [end_of(demo) for demo in demos]
    assert [end.returncode for end in ends] == [0, 0], ends[0].stderr + ends[1].stderr
    places = [re.search(r"live on ROS domain (\S+), (\S+)", end.stdout) for end in ends]
    assert places[0][2] != places[1][2]
    for folder, end in zip(folders, ends, strict=True):
        verdict = end.stdout.strip().splitlines()[-1]
        num_flows, num_possible = map(int, re.search(r"(\d+) of (\d+) flows", verdict).groups())
        assert num_possible == SMALL.num_sweeps - 2
        assert num_flows == flows_and_more(folder)["/scene_flow/flow"] <= num_possible
        _stamps_are_of_the_recording(street, folder)


def _stamps_are_of_the_recording(street: Path, tmp_path: Path) -> None:
    def stamped(path: Path, topic: str) -> dict[tuple[int, int], object]:
        with BagReader(path) as reader:
            return {
                (message.header.stamp.sec, message.header.stamp.nanosec): decode_points(message)
                for message in reader.messages(topic)
            }

    sweeps = stamped(street, "/points")
    flows = stamped(tmp_path / "demo" / "flow", "/scene_flow/flow")
    assert flows
    assert flows.keys() <= set(sorted(sweeps)[1:-1])
    for stamp, cloud in flows.items():
        assert (cloud["x"] == sweeps[stamp]["x"]).all()


def test_a_folder_that_cannot_be_made_is_one_line(street: Path, tmp_path: Path, capsys) -> None:
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where the demo wants its folder")
    assert run(["demo", "--bag", str(street), "--out", str(blocked)]) == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert "blocked" in line
