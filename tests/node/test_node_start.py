# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Arguments of a node at its start: names, parameters, files, qualities of service."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
from node_harness import PATIENCE_S, QUICK
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Float64

# Arguments of ROS, and a part of the one line of answer.
_UNUSABLE = {
    "a value out of range": (
        ["-p", "crop.max_range_m:=-5.0"],
        "]: crop.max_range_m: got -5.0, expected a number from 1 to 1000",
    ),
    "a wrong remapping": (["-r", "nonsense"], "remap rule: '-r nonsense'"),
    "no value": (["-p", "crop.own_body:="], "expected a value after :="),
    "no parameter file": (["--params-file", "{tmp}/bare.yaml"], "ros__parameters"),
    "a quality of service of a wrong type": (
        ["-p", "qos_overrides./scene_flow/flow.publisher.depth:=deep"],
        "depth",
    ),
    "an impossible quality of service": (
        ["-p", "qos_overrides./scene_flow/flow.publisher.depth:=-3"],
        "a topic cannot be used, see qos_overrides",
    ),
}


@pytest.fixture(scope="module")
def failing_starts(start_node, tmp_path_factory):
    """All of them at the same time, which is quicker."""
    folder = tmp_path_factory.mktemp("parameters")
    (folder / "bare.yaml").write_text("crop:\n  max_range_m: 3.0\n")
    return {
        name: start_node({}, *(word.replace("{tmp}", str(folder)) for word in arguments))
        for name, (arguments, _) in _UNUSABLE.items()
    }


@pytest.mark.parametrize("name", _UNUSABLE)
def test_invalid_input_is_an_error_of_one_line(failing_starts, name):
    process = failing_starts[name]
    assert process.wait() == 2
    assert "Traceback" not in process.log
    assert "[scene_flow]" in process.fatal
    assert _UNUSABLE[name][1] in process.fatal


class TestNodeWithNamesAndParameters:
    """`ros2 run ... --ros-args --params-file x.yaml -r __ns:=/robot -r __node:=flow ...`."""

    NAME = "/robot/flow_node"
    DEBUG_TOPICS = ("processing_time_ms", "pipeline_latency_ms", "cyclic_time_ms")

    @pytest.fixture(scope="class")
    def peer(self, run_node, tmp_path_factory):
        path = tmp_path_factory.mktemp("parameters") / "robot.yaml"
        path.write_text(
            "/**:\n"
            "  ros__parameters:\n"
            "    crop:\n"
            "      max_range_m: 60\n"
            "      max_rang_m: 5.0\n"
            "    buffer.max_interval_s: 2\n"
            "    optimization: {max_iterations: 33.0}\n"
            "other_node:\n"
            "  ros__parameters:\n"
            "    crop.max_range_m: 10.0\n"
        )
        parameters = QUICK | {
            "crop.min_range_m": 1,
            "buffer.max_interval_s": 3,
            "node.input_reliability": "best_effort",
            f"qos_overrides.{self.NAME}/flow/moving.publisher.reliability": "best_effort",
            "qos_overrides./lidar/points.subscription.depth": 2,
            "qos_overrides./lidar/points.subscription.reliability": "reliable",
            "use_sim_time": "true",
        }
        names = ("-r", "__ns:=/robot", "-r", "~/points:=/lidar/points")
        peer = run_node(
            parameters, "--params-file", str(path), *names, name=self.NAME, points="/lidar/points"
        )
        peer.wait_for_node("best_effort")
        return peer

    def test_has_the_values_of_the_file_in_the_declared_types(self, peer):
        for name, value in (
            ("crop.max_range_m", 60.0),
            ("optimization.max_iterations", 33),
            # Those of the command line come first.
            ("buffer.max_interval_s", 3.0),
            ("crop.min_range_m", 1.0),
        ):
            assert peer.get(name) == value
            assert type(peer.get(name)) is type(value)

    def test_warns_of_unknown_parameters(self, peer):
        warnings = [line for line in peer.process.log.splitlines() if "unknown parameter" in line]
        assert all("[WARN]" in line for line in warnings)
        (typo, reliability) = warnings
        assert "parameter 'crop.max_rang_m'; did you mean crop.max_range_m" in typo
        assert "points.subscription.reliability" in reliability

    def test_says_which_topics_it_uses(self, peer):
        log = peer.process.log
        assert ", method online, device cpu, 1 thread, ego motion from registration" in log
        assert f"sweeps from /lidar/points, flow on {self.NAME}/flow" in log
        assert peer.values("input")["topic"] == "/lidar/points"
        assert peer.status("flow").name == "robot/flow_node: flow"
        assert peer.status("flow").hardware_id == "/lidar/points"

    def test_takes_qualities_of_service_of_the_user(self, peer):
        (moving,) = peer.node.get_publishers_info_by_topic(f"{self.NAME}/flow/moving")
        assert moving.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        (standing,) = peer.node.get_publishers_info_by_topic(f"{self.NAME}/flow/standing")
        assert standing.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert peer.get("qos_overrides./lidar/points.subscription.depth") == 2
        assert peer.values("input")["reliability"] == "best_effort"

    def test_publishes_its_times(self, peer, drive):
        heard = {name: [] for name in self.DEBUG_TOPICS}
        subscriptions = [
            peer.node.create_subscription(
                Float64, f"{self.NAME}/debug/{name}", heard[name].append, 10
            )
            for name in heard
        ]
        for subscription in subscriptions:
            peer.spin_until(lambda s=subscription: s.get_publisher_count() == 1, "its topics")
        # The node may find the subscriptions late.
        peer.send_until(map(drive.sweep, itertools.count()), lambda: all(heard.values()), "all")
        peer.wait_until_settled()
        for subscription in subscriptions:
            peer.node.destroy_subscription(subscription)
        processing, latency, cycle = (heard[name][-1].data for name in self.DEBUG_TOPICS)
        assert 0 < processing < latency
        assert 0 < cycle < np.inf


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["-h", "--ros-args", "-r", "a:=b"], 0, ("~/points", "~/objects", "--params-file")),
        (
            ["-p", "crop.max_range_m:=60"],
            2,
            ("unrecognized arguments: -p crop.max_range_m:=60; put --ros-args",),
        ),
    ],
)
def test_options_that_are_not_for_ros(arguments, status, words):
    command = [sys.executable, "-m", "mnsf_ros.node", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert ended.returncode == status
    said, nothing = (ended.stderr, ended.stdout) if status else (ended.stdout, ended.stderr)
    assert nothing == ""
    assert all(word in said for word in words)
