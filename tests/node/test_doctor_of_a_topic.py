# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf doctor TOPIC`: what it says of a lidar that runs, and of none."""

import contextlib
import json
import sys
from subprocess import Popen

import pytest

pytest.importorskip("rclpy")

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from msg_utils.other_clouds import CLOUD_TYPE


@pytest.fixture
def street(tmp_path, own_domain):
    """A lidar that stands in a street, which is published again and again."""
    settings = SimulationSettings(duration_s=2.0, num_beams=32, num_columns=256, ego_speed_m_s=0.0)
    path = tmp_path / "street"
    write_recording(settings, path)
    # At a pace that a busy machine follows, and asked about only when it is there.
    command = [sys.executable, "-m", "mnsf_ros.cli", "play", str(path), "--loop", "--rate", "0.5"]
    with Popen(command) as player, contextlib.ExitStack() as stack:
        stack.callback(player.terminate)
        heard = []
        with RawTopics("listener") as ros:
            ros.subscribe("/points", CLOUD_TYPE, heard.append)
            while not heard and player.poll() is None:
                ros.spin_for(0.1)
        assert heard
        yield path


def doctor(*arguments):
    return run(["doctor", *arguments, "--duration-s", "5"])


def test_a_live_topic_is_described_as_its_recording(street, capsys):
    assert doctor("/points", "--odometry", "/truth/odometry", "--json") == 0
    live = json.loads(capsys.readouterr().out)
    assert doctor(str(street), "--json") == 0
    recorded = json.loads(capsys.readouterr().out)
    for name in ("frame", "beams", "own body", "times of points"):
        assert live["facts"][name] == recorded["facts"][name]
    assert live["facts"]["cloud"].endswith("little endian: x y z intensity ring")
    assert live["facts"]["mounting"].startswith("upright")
    assert live["facts"]["rate"].startswith("10.0 Hz")
    assert "from registration" in live["facts"]["odometry"]


def test_another_topic_names_those_that_are_there(street, capsys):
    assert doctor("/truth/odometry") == EXIT_USAGE
    said = capsys.readouterr().err
    assert "/truth/odometry is a nav_msgs/msg/Odometry; clouds are on /points" in said


def test_without_a_lidar_it_ends_with_the_reason(own_domain, capsys):
    assert doctor("/points") == EXIT_USAGE
    assert "no clouds are published, see ROS_DOMAIN_ID" in capsys.readouterr().err
