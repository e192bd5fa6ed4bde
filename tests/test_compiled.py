# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Functions that are compiled when their module is imported."""

import os
import re
import shutil
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


@pytest.fixture
def package(tmp_path) -> Path:
    package = tmp_path / "only_here"
    package.mkdir()
    (package / "loops.py").write_text(_LOOPS)
    return package


def compiles(package: Path, **environment: str) -> bool:
    """Whether a program that uses the loops says that it compiles them, in one line."""
    known = {name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"}
    done = subprocess.run(
        [sys.executable, "-B", "-c", "from only_here.loops import *; print(one_more(1))"],
        cwd=package.parent,
        env=known | {"PYTHONPATH": f"{package.parent}:{ROOT}"} | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "2\n"
    said = done.stderr.count("loops are compiled")
    assert said in (0, 1)
    return said == 1


def test_compiling_is_announced_once_and_later_starts_load_it(package):
    assert compiles(package)
    assert not compiles(package)


def test_code_that_was_installed_is_used_where_the_cache_is_elsewhere(package, tmp_path):
    assert compiles(package)
    elsewhere = tmp_path / "elsewhere"
    for _ in range(2):
        assert not compiles(package, NUMBA_CACHE_DIR=str(elsewhere))
    shutil.rmtree(package / "__pycache__")
    assert not compiles(package, NUMBA_CACHE_DIR=str(elsewhere))


@pytest.mark.slow
def test_without_a_folder_of_the_user_each_process_compiles(package, tmp_path):
    for path in (home := tmp_path / "home", package / "__pycache__"):
        path.write_text("no folder")
    for _ in range(2):
        assert compiles(package, HOME=str(home))


def test_the_installation_compiles_every_loop():
    """Its imports reach all modules with compiled functions."""
    sources = (path.read_text() for path in (ROOT / "mnsf_ros").rglob("*.py"))
    num_loops = sum(len(re.findall(r"^@compiled\(", text, re.MULTILINE)) for text in sources)
    assert num_loops > 5
    command = [sys.executable, "-m", "mnsf_ros.cli.compile_loops"]
    for _ in range(2):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert f"loops compiled: 0, there before: {num_loops}\n" in done.stderr
