# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A new method is one class and one line in the registry; then it runs everywhere."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.core.scene_flow_estimator import MethodTraits
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.methods import make_method, method_names, registry
from mnsf_ros.presets import preset
from mnsf_ros.scene_flow import estimate_flow

SETTINGS = preset("online").changed({"method.name": "nearest"})


@pytest.fixture(scope="module")
def recipe():
    """The class in docs/extending.md."""
    text = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
    blocks = re.findall("```python\n(.*?)```", text, re.DOTALL)
    code = next(block for block in blocks if "class" in block)
    names = {}
    exec(compile(code, "docs/extending.md", "exec"), names)
    return names["NearestPoint"]


@pytest.fixture
def registered(recipe, monkeypatch):
    """The one line in the registry."""
    monkeypatch.setitem(registry._METHODS, "nearest", recipe)


def test_is_known_by_its_name(registered):
    assert "nearest" in method_names()
    assert make_method("nearest", SETTINGS).traits == MethodTraits(num_sweeps=2)
    points = small.xyz(0)
    flow = estimate_flow(points, points, settings=SETTINGS).flow
    assert not flow.any()


def test_is_scored_by_the_evaluator(registered, tmp_path):
    bag = small.write_recording(tmp_path / "drive")
    rows = [
        row
        for row in run_task(small.task_at(bag, "nearest"), small.options())
        if isinstance(row, ResultRow)
    ]
    assert len(rows) == 4
    assert all(row.errors and np.isfinite(row.errors["all"].epe_m) for row in rows)
