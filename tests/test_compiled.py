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


@pytest.mark.parametrize(
    "values", [np.zeros(3), np.zeros((3, 1), np.float32), np.zeros(6, "f4")[::2]]
)
def test_other_types_are_refused_instead_of_compiled(values):
    with pytest.raises(TypeError, match="No matching definition"):
        total(values)


@pytest.mark.parametrize(("has_folder", "kind"), [(True, "FunctionCache"), (False, "NullCache")])
def test_works_with_and_without_a_folder_for_the_cache(tmp_path, has_folder, kind):
    package = tmp_path / "only_here"
    package.mkdir()
    (package / "sums.py").write_text(
        "from mnsf_ros.compiled import compiled\n\n\n"
        "@compiled('int64(int64)')\n"
        "def next_number(number):\n    return number + 1\n"
    )
    home = tmp_path / "home"
    if not has_folder:
        home.write_text("no folder")
        (package / "__pycache__").write_text("no folder")
    command = "from only_here.sums import next_number as f; print(f(1), type(f._cache).__name__)"
    result = subprocess.run(
        [sys.executable, "-B", "-c", command],
        cwd=tmp_path,
        env={
            **{name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"},
            "PYTHONPATH": f"{tmp_path}:{ROOT}",
            "HOME": str(home),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.stdout.split() == ["2", kind], result.stderr


def _output_of(command, folder, cache):
    return subprocess.run(
        [sys.executable, "-B", "-c", command],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{folder}:{ROOT}", "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )


def test_compiling_is_told_once_and_only_where_it_happens(tmp_path):
    (tmp_path / "loops.py").write_text(
        "from mnsf_ros.compiled import compiled\n\n\n"
        "@compiled('int64(int64)')\ndef one_more(number):\n    return number + 1\n\n\n"
        "@compiled('int64(int64)')\ndef one_less(number):\n    return number - 1\n"
    )
    command = "print('begin', flush=True); import loops; print(loops.one_more(1))"
    first, second = (_output_of(command, tmp_path, tmp_path / "cache") for _ in range(2))
    assert first.stdout == second.stdout == "begin\n2\n"
    assert first.stderr.count("loops are compiled") == 1
    assert second.stderr == ""


def test_setup_compiles_every_loop():
    """What `make setup` imports has all modules with compiled functions in it."""
    line = re.search(r'python -c "(import mnsf_ros[^"]*)"', (ROOT / "Makefile").read_text())[1]
    wanted = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in (ROOT / "mnsf_ros").rglob("*.py")
        if re.search(r"^@compiled\(", path.read_text(), re.MULTILINE)
    }
    assert "mnsf_ros.drawing.color_wheel" in wanted
    script = f"{line}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert wanted - set(done.stdout.split()) == set()
