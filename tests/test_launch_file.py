# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the launch file starts, with the real `launch` where it is installed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("launch_ros")

ROOT = Path(__file__).parents[1]

# As `ros2 launch` does.
_SCRIPT = """
import sys
from launch import LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

path, *arguments = sys.argv[1:]
service = LaunchService()
service.include_launch_description(
    IncludeLaunchDescription(
        PythonLaunchDescriptionSource(path),
        launch_arguments=[tuple(word.split(":=", 1)) for word in arguments],
    )
)
sys.exit(service.run())
"""


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An installation whose node and RViz only print their arguments."""
    prefix = tmp_path_factory.mktemp("prefix")
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    for folder in ("config", "launch", "rviz"):
        shutil.copytree(ROOT / folder, prefix / "share" / "mnsf_ros" / folder)
    for package, executable in (
        ("mnsf_ros", "scene_flow_node"),
        ("mnsf_ros", "scene_flow_lifecycle_node"),
        ("mnsf_ros", "mnsf"),
        ("rviz2", "rviz2"),
    ):
        (index / package).touch()
        program = prefix / "lib" / package / executable
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text(f'#!/bin/sh\necho started {executable} "$@"\n')
        program.chmod(0o755)
    return prefix


def launched(prefix: Path, *arguments: str) -> tuple[int, str]:
    """Exit status and output of a launch."""
    environment = os.environ | {
        "AMENT_PREFIX_PATH": str(prefix),
        "ROS_LOG_DIR": str(prefix / "log"),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
    }
    path = prefix / "share" / "mnsf_ros" / "launch" / "scene_flow.launch.py"
    ended = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(path), *arguments],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    return ended.returncode, ended.stdout


def test_names_are_relative(prefix: Path) -> None:
    status, output = launched(prefix, "points:=points", "namespace:=front", "name:=flow")
    assert status == 0, output
    (line,) = (line for line in output.splitlines() if "started scene_flow_node" in line)
    for word in (
        "__node:=flow",
        "__ns:=/front",
        "~/points:=points",
        "~/odometry:=odom",
        "--log-level info",
    ):
        assert word in line
    assert "~/flow:=" not in line


@pytest.mark.parametrize("words", [[], ["points:=auto"]])
def test_the_node_looks_for_a_topic_that_is_not_named(prefix: Path, words: list[str]) -> None:
    status, output = launched(prefix, *words)
    assert status == 0, output
    assert "~/points:=" not in output
    assert "~/odometry:=odom" in output


def test_rviz_shows_the_topics_of_the_node(prefix: Path) -> None:
    _, output = launched(
        prefix, "points:=/x", "rviz:=true", "namespace:=front", "fixed_frame:=velodyne"
    )
    (line,) = (line for line in output.splitlines() if "started rviz2" in line)
    assert "--fixed-frame velodyne" in line
    assert "/scene_flow/flow:=/front/scene_flow/flow " in line
    assert "/scene_flow/objects/markers:=/front/scene_flow/objects/markers" in line


def test_several_lidars_and_a_flow_that_takes_its_parts_along(prefix: Path) -> None:
    words = ("use_sim_time:=True", "flow:=motion", "log_level:=debug", "view:=true", "view_port:=0")
    status, output = launched(prefix, "points:=/front/points,rear/points", *words)
    assert status == 0
    for word in ("~/flow:=motion ", "~/flow/moving:=motion/moving", "~/flow/standing:=motion/stan"):
        assert word in output
    assert "started mnsf view --node /scene_flow --flow /motion --port 0" in output
    assert "--log-level debug" in output
    assert "~/points:=/front/points " in output
    assert "~/points_2:=rear/points " in output
    (path,) = (word for word in output.split() if Path(word).name.startswith("launch_params"))
    assert "lidars.count: 2" in Path(path).read_text()


def test_a_bag_is_played_and_shown(prefix: Path, make_street) -> None:
    street = make_street()
    status, output = launched(prefix, f"bag:={street}", "namespace:=front", "rviz:=true")
    assert status == 0, output
    assert f"started mnsf play {street} --clock --wait" in output
    assert "started mnsf view --node /front/scene_flow --port 8766" in output
    assert "~/points:=/points " in output
    assert "--fixed-frame lidar" in output
    (path,) = (word for word in output.split() if Path(word).name.startswith("launch_params"))
    assert "use_sim_time: true" in Path(path).read_text()


def test_the_view_may_be_left_out_and_the_topic_named(prefix: Path, make_street) -> None:
    _, output = launched(prefix, f"bag:={make_street()}", "view:=false", "points:=/other")
    assert "~/points:=/other " in output
    assert "mnsf view" not in output


@pytest.mark.parametrize("switch", ["true", "FALSE"])
def test_node_with_or_without_a_life_cycle(prefix: Path, switch: str) -> None:
    status, output = launched(prefix, "points:=/x", f"lifecycle:={switch}", "autostart:=false")
    assert status == 0
    assert ("started scene_flow_lifecycle_node" in output) == (switch == "true")
    assert ("started scene_flow_node" in output) == (switch == "FALSE")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["points:=/x", "params_file:=/no/such.yaml"], "there is no file /no/such.yaml"),
        (["points:=/x", "rviz:=perhaps"], "expected true or false"),
        (["bag:=/no/such/recording"], "/no/such/recording: no such file or folder"),
    ],
)
def test_what_cannot_be_used_starts_nothing(prefix: Path, arguments: list[str], words: str) -> None:
    status, output = launched(prefix, *arguments)
    assert status == 1
    assert words in output
    assert "process started" not in output


def test_rviz_that_is_not_installed_starts_nothing(prefix: Path) -> None:
    marker = prefix / "share" / "ament_index" / "resource_index" / "packages" / "rviz2"
    marker.unlink()
    try:
        status, output = launched(prefix, "points:=/x", "rviz:=true")
    finally:
        marker.touch()
    assert status == 1
    assert "the package rviz2 is not installed" in output
    assert "process started" not in output
