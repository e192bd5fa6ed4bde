# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch
from scene_flow_process import NETWORK
from synthetic_clouds import MOTION, flow_columns
from waiting import PATIENCE_S

from mnsf_ros.node.node_log import greeting
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings

# What the user gives, and what the one line of answer must have in it.
_UNUSABLE = {
    "a value out of range": (
        ["-p", "crop.max_range_m:=-5.0"],
        "]: crop.max_range_m: got -5.0, expected a number from 1 to 1000",
    ),
    "a word for a number": (["-p", "crop.max_range_m:=far"], "crop.max_range_m: got 'far'"),
    "a contradiction": (["-p", "crop.min_range_m:=90"], "expected less than crop.max_range_m"),
    "a wrong sim time": (["-p", "use_sim_time:=maybe"], "use_sim_time"),
    "a wrong remapping": (["-r", "nonsense"], "remap rule: '-r nonsense'"),
    "a missing file": (["--params-file", "/no/such.yaml"], "Error opening YAML file"),
    "a broken file": (["--params-file", "{tmp}/broken.yaml"], "broken.yaml"),
    "no parameter file": (["--params-file", "{tmp}/bare.yaml"], "ros__parameters"),
    "a wrong quality of service": (
        ["-p", "qos_overrides./scene_flow/flow.publisher.reliability:=perhaps"],
        "perhaps",
    ),
    "a quality of service of a wrong type": (
        ["-p", "qos_overrides./scene_flow/flow.publisher.depth:=deep"],
        "depth",
    ),
    "an impossible quality of service": (
        ["-p", "qos_overrides./scene_flow/flow.publisher.depth:=-3"],
        "a topic cannot be used, see qos_overrides",
    ),
    "an unknown flag": (["--frobnicate"], "--frobnicate"),
}
if not torch.cuda.is_available():
    _UNUSABLE["a missing device"] = (["-p", "compute.device:=cuda"], "no usable CUDA device")


@pytest.fixture(scope="module")
def failing_starts(start_node, tmp_path_factory):
    """All of them at the same time, which is quicker."""
    folder = tmp_path_factory.mktemp("parameters")
    (folder / "broken.yaml").write_text("/**:\n  ros__parameters:\n    crop:\n   max: [1, a]\n")
    (folder / "bare.yaml").write_text("crop:\n  max_range_m: 3.0\n")
    return {
        name: start_node({}, *(word.replace("{tmp}", str(folder)) for word in arguments))
        for name, (arguments, _) in _UNUSABLE.items()
    }


@pytest.mark.parametrize("name", _UNUSABLE)
def test_what_cannot_be_used_is_said_in_one_line(failing_starts, name):
    process = failing_starts[name]
    assert process.wait() == 2
    assert "Traceback" not in process.log
    (fatal,) = (line for line in process.log.splitlines() if "[FATAL]" in line)
    assert "[scene_flow]" in fatal
    assert _UNUSABLE[name][1] in fatal


class TestRenamedNodeWithParameterFile:
    """`ros2 run ... --ros-args --params-file x.yaml -r __ns:=/robot -r __node:=flow ...`."""

    NAME = "/robot/flow_node"

    @pytest.fixture(scope="class")
    def process(self, start_node, tmp_path_factory):
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
        parameters = NETWORK | {
            "crop.min_range_m": 1,
            "buffer.max_interval_s": 3,
            "node.input_reliability": "best_effort",
            "use_sim_time": "true",
            "typo": "true",
        }
        del parameters["optimization.max_iterations"]
        return start_node(
            parameters,
            *("--params-file", str(path)),
            *("-r", "__ns:=/robot"),
            *("-r", "__node:=flow_node"),
            *("-r", "~/points:=/lidar/points"),
        )

    @pytest.fixture(scope="class")
    def peer(self, process, make_peer):
        peer = make_peer(process, node_name=self.NAME, points="/lidar/points")
        peer.wait_for_node("best_effort")
        return peer

    def test_has_the_values_of_the_file(self, peer):
        assert peer.get("crop.max_range_m") == 60
        assert peer.get("optimization.max_iterations") == 33

    def test_has_each_value_in_the_type_that_is_declared(self, peer):
        assert type(peer.get("crop.max_range_m")) is float
        assert type(peer.get("optimization.max_iterations")) is int
        assert type(peer.get("crop.min_range_m")) is float

    def test_has_the_values_of_the_command_line_before_those_of_the_file(self, peer):
        assert peer.get("buffer.max_interval_s") == 3
        assert peer.get("crop.min_range_m") == 1

    def test_warns_of_parameters_that_it_does_not_have(self, peer, process):
        warnings = [line for line in process.log.splitlines() if "unknown parameter" in line]
        assert len(warnings) == 2
        assert all("[WARN]" in line for line in warnings)
        assert "parameter 'crop.max_rang_m'" in warnings[0]
        assert "parameter 'typo'" in warnings[1]

    def test_says_which_topics_it_uses(self, peer, process):
        assert ", method mnsf, device cpu, 1 thread, ego motion from registration" in process.log
        assert "sweeps from /lidar/points, flow on /robot/flow_node/flow" in process.log
        assert peer.values("input")["topic"] == "/lidar/points"

    def test_gives_flow_without_a_clock(self, peer, drive):
        assert peer.get("use_sim_time") is True
        sweeps = drive.sweeps(0, 1, 2)
        peer.send(*sweeps)
        errors_m = np.linalg.norm(flow_columns(peer.flow_of(sweeps[1])) - MOTION, axis=1)
        assert np.median(errors_m) < 0.1
        peer.wait_until_settled()
        assert peer.values("flow")["forward iterations, last"] == "33"

    def test_keeps_the_reliability_that_it_was_given(self, peer):
        assert peer.values("input")["reliability"] == "best_effort"


class TestCommandLine:
    """What is not for ROS."""

    def run(self, *arguments):
        command = [sys.executable, "-m", "mnsf_ros.node", *arguments]
        return subprocess.run(
            command, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )

    @pytest.mark.parametrize("arguments", [["--help"], ["--ros-args", "-r", "a:=b", "--", "-h"]])
    def test_help_says_how_to_start_the_node(self, arguments):
        ended = self.run(*arguments)
        assert (ended.returncode, ended.stderr) == (0, "")
        for word in ("~/points", "~/objects", "--ros-args", "--params-file"):
            assert word in ended.stdout

    @pytest.mark.parametrize(
        "arguments", [["--frobnicate"], ["-p", "crop.max_range_m:=60"], ["--ros-args", "--", "x"]]
    )
    def test_other_options_are_refused(self, arguments):
        ended = self.run(*arguments)
        assert (ended.returncode, ended.stdout) == (2, "")
        assert "error: unrecognized arguments" in ended.stderr
        assert "--ros-args" in ended.stderr


def test_greeting_names_what_differs_from_a_preset():
    start = "preset online, method online, device auto, 2 threads, ego motion from "
    settings = Settings().changed({"compute.num_threads": 2})
    assert greeting(settings) == f"{start}registration"
    changed = settings.changed({"ego_motion.source": "odometry", "crop.max_range_m": 60})
    assert greeting(changed).startswith("preset online but for crop.max_range_m, ego_motion.source")
    paper = preset("paper").changed({"compute.num_threads": 1})
    assert greeting(paper).startswith("preset paper, method mnsf, device auto, 1 thread, ")
    names = ("min_range_m", "max_range_m", "min_height_m", "max_height_m")
    many = {f"crop.{name}": 1.5 * index for index, name in enumerate(names, start=1)}
    many |= {"ground.window_m": 9, "ground.cell_size_m": 0.6, "objects.max_points": 5000}
    assert "preset online with 7 changes, " in greeting(Settings().changed(many))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_libraries_are_loaded_ends_the_node_quietly(start_node, number):
    give_up = time.monotonic() + PATIENCE_S
    while True:
        process = start_node({})
        while not process.has_loaded("_multiarray_umath"):
            assert time.monotonic() < give_up
        assert process.stop(number) == 0
        # Where this process was held up meanwhile, the node has said what it uses: once more.
        if "sweeps from" not in process.log:
            break
    assert process.log == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_as_soon_as_the_node_is_there_ends_it_quietly(start_node, number):
    process = start_node({})
    give_up = time.monotonic() + PATIENCE_S
    while not process.has_loaded("libfastrtps"):
        assert time.monotonic() < give_up
    assert process.stop(number) == 0
    assert "Traceback" not in process.log
    assert "ERROR" not in process.log
