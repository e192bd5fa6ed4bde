# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Functions that are compiled when their module is imported."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.compiled import compiled

ROOT = Path(__file__).resolve().parents[1]


@compiled("float32(float32[::1])")
def total(values):
    result = np.float32(0.0)
    for value in values:
        result += value
    return result


def test_sums_in_the_order_of_the_loop():
    values = np.random.default_rng(0).normal(size=1000).astype(np.float32)
    in_order = np.float32(0.0)
    for value in values:
        in_order += value
    assert total(values) == in_order


_LOOPS = """
from mnsf_ros.compiled import compiled

@compiled("int64(int64)")
def one_more(number):
    return number + 1

@compiled("int64(int64)")
def one_less(number):
    return number - 1
"""


@pytest.mark.parametrize(
    "has_folder", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["folder", "no folder"]
)
def test_compiling_is_announced_once_and_later_starts_load_it(tmp_path, has_folder):
    package, home = tmp_path / "only_here", tmp_path / "home"
    package.mkdir()
    (package / "loops.py").write_text(_LOOPS)
    if not has_folder:
        home.write_text("no folder")
        (package / "__pycache__").write_text("no folder")
    environment = {name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"}
    environment |= {"PYTHONPATH": f"{tmp_path}:{ROOT}", "HOME": str(home)}
    command = [sys.executable, "-B", "-c", "from only_here.loops import *; print(one_more(1))"]
    for is_compiled in (True, not has_folder):
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        assert done.stdout == "2\n"
        assert done.stderr.count("loops are compiled") == is_compiled


def test_setup_compiles_every_loop():
    """The imports of `make setup` reach all modules with compiled functions."""
    line = re.search(r'python -c "(import mnsf_ros[^"]*)"', (ROOT / "Makefile").read_text())[1]
    wanted = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in (ROOT / "mnsf_ros").rglob("*.py")
        if re.search(r"^@compiled\(", path.read_text(), re.MULTILINE)
    }
    script = f"{line}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert len(wanted) > 5
    assert wanted - set(done.stdout.split()) == set()
