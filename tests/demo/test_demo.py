# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The demo with a small simulated street: the real node over real DDS."""

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.recording.bag_reader import BagReader
from msg_utils.point_cloud2 import decode_points

DURATION_S = 2.0


def start_demo(folder: Path, street: Path) -> subprocess.Popen[str]:
    environment = os.environ | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros_log"),
        "COLUMNS": "120",
    }
    arguments = ["--out", str(folder / "demo"), "--bag", str(street), "--points", "/points"]
    return subprocess.Popen(
        [sys.executable, "-m", "mnsf_ros.cli", "demo", *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def output_of(demo: subprocess.Popen[str]) -> str:
    with demo:
        stdout, stderr = demo.communicate(timeout=300)
    assert demo.returncode == 0, stderr
    return stdout


@pytest.fixture(scope="module")
def street(make_street) -> Path:
    # Slow enough that a loaded machine estimates at least one triplet before the recording ends.
    return make_street(duration_s=DURATION_S, num_columns=360)


def test_demo_shows_records_and_draws_the_flow(street: Path, tmp_path: Path) -> None:
    shown = output_of(start_demo(tmp_path, street))
    for words in ("EPE (m)", "without ground", "- dynamic", "- static", " flows"):
        assert words in shown
    picture = tmp_path / "demo" / "flow.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    with BagReader(tmp_path / "demo" / "flow") as reader:
        names = {field.name for field in next(reader.messages("/scene_flow/flow")).fields}
        assert {"x", "y", "z", "intensity", "ring", "flow_x", "flow_y", "flow_z", "rgb"} <= names
        assert reader.topics["/scene_flow/objects/markers"].count > 0
        assert reader.topics["/diagnostics"].count > 0


@pytest.mark.slow
def test_every_vehicle_of_the_street_that_the_demo_simulates_is_found(
    make_street, tmp_path: Path
) -> None:
    """Once, a crossing car of 600 points was lost for two seconds."""
    street = make_street(seed=0, duration_s=6.0, num_beams=64, num_columns=1900)
    out = str(tmp_path / "out")
    assert run(["evaluate", str(street), "--methods=online", "--pictures=0", "--out", out]) == 0
    with (tmp_path / "out" / "results.csv").open() as file:
        assert float(next(csv.DictReader(file))["fast_found"]) > 0.98


def clouds(path: Path, topic: str) -> dict[int, object]:
    """Time to points."""
    with BagReader(path) as reader:
        return {
            message.header.stamp.sec * 10**9 + message.header.stamp.nanosec: decode_points(message)
            for message in reader.messages(topic)
        }


@pytest.mark.slow
def test_two_demos_at_once_do_not_mix(street: Path, tmp_path: Path) -> None:
    """Of the same sweeps, at the same time: each has only the flows of its own node."""
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
    shown = [output_of(demo) for demo in [start_demo(folder, street) for folder in folders]]
    first, second = (re.search(r"live on ROS domain (\S+), (\S+)", text)[2] for text in shown)
    assert first != second
    sweeps = clouds(street, "/points")
    for folder, text in zip(folders, shown, strict=True):
        verdict = text.strip().splitlines()[-1]
        num_flows, num_possible = map(int, re.search(r"(\d+) of (\d+) flows", verdict).groups())
        flows = clouds(folder / "demo" / "flow", "/scene_flow/flow")
        assert 0 < num_flows == len(flows) <= num_possible == 10 * DURATION_S - 2
        assert flows.keys() <= set(sorted(sweeps)[1:-1])
        for stamp_ns, cloud in flows.items():
            assert (cloud["x"] == sweeps[stamp_ns]["x"]).all()


def test_a_folder_that_cannot_be_made_is_one_line(street: Path, tmp_path: Path, capsys) -> None:
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where the demo wants its folder")
    assert run(["demo", "--bag", str(street), "--out", str(blocked)]) == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert "blocked" in line
