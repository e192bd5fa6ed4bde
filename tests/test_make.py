# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What `make` starts and installs."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_PATIENCE_S = 600  # however busy the machine is
_HAS_PROGRAMS = Path(sys.prefix, "bin", "scene_flow_node").exists()


_NEEDS_NODE = pytest.mark.skipif(
    not _HAS_PROGRAMS or importlib.util.find_spec("rclpy") is None or shutil.which("make") is None,
    reason="needs make, ROS and the installed package",
)


def started_demo(recording):
    of_tests = f"--old-file={sys.prefix}/ready", f"VENV={sys.prefix}"
    # CI runs the tests by make, and a make in a make says which folder it enters.
    quiet = "--no-print-directory"
    alone = f"DOMAIN={os.environ['ROS_DOMAIN_ID']}", "VIEW_OPTIONS=--port 0"
    return subprocess.Popen(
        ["make", quiet, *of_tests, *alone, "demo", f"BAG={recording}"],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.usefixtures("own_domain")
@_NEEDS_NODE
def test_a_demo_ends_with_its_address_and_with_make(make_street):
    demo = started_demo(make_street())
    said = [next(demo.stdout), next(demo.stdout)]
    demo.send_signal(signal.SIGTERM)
    # Its output ends with the last process that has it.
    after, _ = demo.communicate(timeout=_PATIENCE_S)
    page, playing = sorted(said)
    assert page.startswith("open http://127.0.0.1:")
    assert playing.startswith("playing ")
    assert "Traceback" not in after
    assert demo.returncode == -signal.SIGTERM or demo.returncode > 0


@pytest.mark.usefixtures("own_domain")
@_NEEDS_NODE
def test_a_demo_ends_with_the_first_of_its_programs(tmp_path):
    # The node and the page would go on without a recording.
    demo = started_demo(tmp_path)
    said, _ = demo.communicate(timeout=_PATIENCE_S)
    assert f"mnsf: {tmp_path}: " in said
    assert "Traceback" not in said
    assert demo.returncode == 2


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
@pytest.mark.parametrize("target", ["demo", "view"])
def test_a_recording_that_does_not_exist_is_refused_before_all_else(tmp_path, target):
    missing = tmp_path / "no where"
    done = subprocess.run(
        ["make", f"VENV={tmp_path}/venv", target, f"BAG={missing}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert f"BAG={missing}: no such recording" in done.stderr
    assert not any(tmp_path.iterdir())


_PIP = """#!/bin/sh
echo "$*" >> "{calls}"
case "$*" in
*--index-url*) exit {index_status} ;;
*--dry-run*) echo "Would install {needed} torch" ;;
esac
"""


@pytest.mark.skipif(
    shutil.which("make") is None or shutil.which("nvidia-smi") is not None,
    reason="needs make, and no GPU, for which PyTorch is taken with CUDA",
)
@pytest.mark.parametrize(
    ("index_status", "needed", "has_networks"),
    [(0, "", True), (1, "sympy", True), (1, "nvidia-cudnn-cu13", False)],
    ids=["its index", "another without CUDA", "CUDA only"],
)
def test_pytorch_for_the_tests_never_takes_gigabytes(tmp_path, index_status, needed, has_networks):
    calls, pip = tmp_path / "calls", tmp_path / "pip"
    pip.write_text(_PIP.format(calls=calls, index_status=index_status, needed=needed))
    pip.chmod(0o755)
    (tmp_path / "bin").mkdir()
    (tmp_path / "ready").touch()
    done = subprocess.run(
        ["make", f"--old-file={tmp_path}/ready", f"VENV={tmp_path}", f"PIP={pip}", "complete"],
        cwd=ROOT,
        env={"PATH": os.defpath},
        capture_output=True,
        text=True,
        check=True,
    )
    asked = calls.read_text().splitlines()[-1]
    assert ",networks," in asked if has_networks else "networks" not in asked
    assert ("Tests of networks are skipped" in done.stdout) is not has_networks
    assert (tmp_path / "complete").exists()
