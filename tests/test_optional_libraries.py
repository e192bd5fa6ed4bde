# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""PyTorch, ROS and other libraries are needed only where they are used; errors name them."""

import importlib.util
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mnsf_ros.cli import main
from mnsf_ros.errors import library_missing
from mnsf_ros.evaluation import run_record

ROOT = Path(__file__).parents[1]
SOURCES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in ("msg_utils", "mnsf_ros")
    for path in sorted((ROOT / package).rglob("*.py"))
]
_ROS = ["rclpy", "sensor_msgs", "std_msgs", "nav_msgs", "rcl_interfaces", "visualization_msgs"]
_PATIENCE_S = 600  # however busy the machine is

# Imports modules, or runs a program of this package, in a Python without some libraries.
_WITHOUT = """
import sys
names, module, *arguments = sys.argv[1:]
sys.modules.update(dict.fromkeys(names.split(",")))
sys.argv = [module, *arguments]
import importlib
for name in module.split(","):
    imported = importlib.import_module(name)
if name.endswith("__main__"):
    imported.main()
"""


@pytest.mark.parametrize(
    ("packages", "missing"),
    [
        (["cli.main", "node.environment"], ["numpy"]),
        (["errors", "settings", "presets"], ["torch", "numpy", "scipy", "rosbags", *_ROS]),
        (["cli", "evaluation", "report", "datasets"], ["torch", *_ROS]),
        (["view", "simulation", "online"], ["torch", "cattrs", "jinja2", "pandas"]),
    ],
    ids=lambda names: names[0],
)
def test_packages_are_imported_without_what_they_do_not_need(packages, missing):
    starts = tuple(f"mnsf_ros.{package}" for package in packages)
    modules = [name for name in SOURCES if name.startswith(starts)]
    assert len(modules) >= len(packages)
    process = started(",".join(missing), ",".join(modules))
    output, _ = process.communicate(timeout=_PATIENCE_S)
    assert process.returncode == 0, output


def started(names: str, module: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", _WITHOUT, names, module, *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


# Runs commands one after the other and prints the status of each.
_COMMANDS = """
import sys
names, *commands = sys.argv[1:]
sys.modules.update(dict.fromkeys(names.split(",")))
from mnsf_ros.cli import main
for command in commands:
    try:
        status = main.run(command.split())
    except SystemExit as ended:
        status = ended.code
    print(command, "->", status)
"""
_SLOW = "torch,numba,scipy,matplotlib,pandas,optuna,rclpy"
# Of each command that reads a path, one that is not there is found before the slow imports.
_MISSING = (
    "view missing",
    "play missing",
    "doctor missing",
    "evaluate missing",
    "estimate missing --out x",
    "explain missing --stamp 1.5 --at 1,2",
    "report missing",
    "study frames missing",
    "tune missing",
    "convert kitti missing x",
    "export opensceneflow missing --out x",
)


def test_arguments_are_checked_before_libraries_that_take_long_are_loaded():
    """So that mistakes are said at once."""
    helps = [f"{name} --help" for name in (*main.COMMANDS, "")]
    good = ["parameters", *map(str.strip, helps)]
    words = [sys.executable, "-c", _COMMANDS, _SLOW, *good, *_MISSING]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    statuses = re.findall(r"^(.+) -> (\d)$", done.stdout, re.MULTILINE)
    assert dict(statuses) == dict.fromkeys(good, "0") | dict.fromkeys(_MISSING, "2")
    lines = done.stderr.splitlines()
    assert len(lines) == len(_MISSING)
    assert all(line.startswith("mnsf: missing: no such file or folder") for line in lines)
    without_path = {"simulate", "parameters"}
    assert {line.split()[0] for line in _MISSING} == main.COMMANDS.keys() - without_path


@pytest.mark.parametrize(
    ("names", "module", "arguments", "words"),
    [
        ("torch", "mnsf_ros.cli.__main__", ("study", "landscape", "{street}"), "make complete"),
        ("numpy", "mnsf_ros.cli.__main__", ("simulate", "{tmp}/street"), "colcon build"),
        ("numpy", "mnsf_ros.node.__main__", (), "numpy"),
        (
            "h5py",
            "mnsf_ros.cli.__main__",
            ("convert", "opensceneflow", "{tmp}", "{tmp}/out"),
            "pip install '.[datasets]'",
        ),
    ],
)
def test_a_missing_library_is_one_line(tmp_path, make_street, names, module, arguments, words):
    paths = {"tmp": tmp_path, "street": make_street() if "{street}" in arguments else None}
    process = started(names, module, *(word.format(**paths) for word in arguments))
    output, _ = process.communicate(timeout=_PATIENCE_S)
    assert process.returncode == 2
    (line,) = output.strip().splitlines()
    assert f"the Python library {names!r} is not installed for {sys.executable}" in line
    assert words in line


def test_other_libraries_are_named_by_their_package():
    text = library_missing(ModuleNotFoundError("No module named 'a.b'", name="a.b"))
    assert "'a'" in text


def test_a_run_is_recorded_without_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    assert run_record.session_now([])["machine"].endswith(" cores")


@pytest.mark.usefixtures("own_domain")
@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="needs ROS")
class TestNode:
    """The node, which also needs rclpy."""

    def test_starts_without_torch(self):
        process = started("torch", "mnsf_ros.node.__main__")
        for line in process.stdout:
            if "waits for the only topic of clouds, flow on /scene_flow/flow" in line:
                break
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=_PATIENCE_S)
        assert process.returncode == 0, output
        assert "Traceback" not in output

    def test_refuses_networks_in_one_line(self):
        words = ("--ros-args", "-p", "method.name:=mnsf")
        process = started("torch", "mnsf_ros.node.__main__", *words)
        output, _ = process.communicate(timeout=_PATIENCE_S)
        assert process.returncode == 2
        (line,) = output.strip().splitlines()
        assert "method 'mnsf': the Python library 'torch' is not installed" in line
