"""The demo with a small simulated street: the real node over real DDS."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from msg_utils.point_cloud2 import decode_points

# Slow enough that a loaded machine estimates at least one triplet before the recording ends.
SMALL = SimulationSettings(num_beams=16, num_columns=360, duration_s=2.0)


def run_demo(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 101),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros_log"),
        "COLUMNS": "120",
    }
    return subprocess.run(
        [sys.executable, "-m", "mnsf_ros.cli", "demo", "--out", str(folder / "demo"), *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "street"
    write_recording(SMALL, path)
    return path


def test_demo_shows_records_and_draws_the_flow(street: Path, tmp_path: Path) -> None:
    done = run_demo(tmp_path, "--bag", str(street))
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
        assert {"x", "y", "z", "intensity", "ring", "flow_x", "flow_y", "flow_z"} <= names
        assert reader.topics["/diagnostics"].count > 0


def test_recorded_flow_belongs_to_sweeps_of_the_recording(street: Path, tmp_path: Path) -> None:
    assert run_demo(tmp_path, "--bag", str(street), "--topic", "/points").returncode == 0

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


def test_a_node_that_cannot_run_is_one_line(street: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where the demo wants its folder")
    done = run_demo(tmp_path, "--bag", str(street), "--out", str(blocked))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "blocked" in done.stderr
