# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Ctrl-C while Python still imports, or already ends: a word and a status, no traceback."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]

# Interrupts itself when it comes to import a module, or at the end.
_SCRIPT = """
import atexit, os, signal, sys

command, module, *sys.argv[1:] = sys.argv[1:]
# The parent may ignore it, as of `make test &`.
signal.signal(signal.SIGINT, signal.default_int_handler)

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)

class Interrupting:
    def find_spec(self, name, *_rest):
        if name == module:
            interrupt()

sys.meta_path.insert(0, Interrupting())
if module == "the end":
    atexit.register(interrupt)
from importlib import import_module
sys.modules.pop(module, None)
import_module(command).main()
"""


def interrupted(command: str, module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", _SCRIPT, command, module, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.mark.parametrize("module", ["mnsf_ros.cli.main", "argparse", "mnsf_ros.cli.parameters"])
def test_of_the_command_line_while_it_starts(module: str) -> None:
    ended = interrupted("mnsf_ros.cli.__main__", module, "parameters")
    assert (ended.returncode, ended.stdout) == (130, "")
    assert ended.stderr == "mnsf: interrupted\n"


_WITHIN_EXEC = """
    exec("os.kill(os.getpid(), signal.SIGTERM); [i for i in range(1000)]")
"""

# As modules in C++ do while they are imported.
_WITHIN_EXTENSION = """
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(300)
    except KeyboardInterrupt as error:
        raise ImportError("initialization failed") from error
"""


@pytest.mark.parametrize("place", [_WITHIN_EXEC, _WITHIN_EXTENSION])
def test_of_the_command_line_where_python_swallows_it_or_ends_itself(
    tmp_path: Path, place: str
) -> None:
    """Dataclasses are made by exec() while they are imported."""
    script = f"""
import os, signal, time
from mnsf_ros.cli import main, parameters

def interrupted(options):{place}
parameters.run_parameters = interrupted
main.main(["parameters"])
"""
    (tmp_path / "interrupted.py").write_text(script)
    ended = subprocess.run(
        [sys.executable, "-m", "interrupted"],
        env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (130, "mnsf: interrupted\n")


def test_of_the_command_line_while_it_ends() -> None:
    ended = interrupted("mnsf_ros.cli.__main__", "the end", "parameters")
    assert (ended.returncode, ended.stderr) == (130, "")
    assert "ros__parameters" in ended.stdout


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="needs ROS")
@pytest.mark.parametrize(
    "module", ["signal", "mnsf_ros.node.environment", "mnsf_ros.errors", "rclpy"]
)
def test_of_the_node_while_it_starts(module: str) -> None:
    ended = interrupted("mnsf_ros.node.__main__", module)
    assert (ended.returncode, ended.stderr) == (0, "")
