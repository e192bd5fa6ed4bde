# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A new method is one class and one line in the registry; then it runs everywhere."""

import re
from pathlib import Path

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.evaluation.task import run_task
from mnsf_ros.methods import registry
from mnsf_ros.presets import preset
from mnsf_ros.scene_flow import estimate_flow


@pytest.fixture
def registered(monkeypatch):
    """The class in docs/extending.md, and one line in the registry."""
    text = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
    blocks = re.findall("```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(compile(next(block for block in blocks if "class" in block), "extending", "exec"), names)
    monkeypatch.setitem(registry._METHODS, "nearest", names["NearestPoint"])


@pytest.mark.usefixtures("registered")
def test_is_known_by_its_name_and_scored_by_the_evaluator(tmp_path):
    points = small.xyz(0)
    settings = preset("online").changed({"method.name": "nearest"})
    assert not estimate_flow(points, points, settings=settings).flow.any()
    bag = small.write_recording(tmp_path / "drive")
    *rows, _ = run_task(small.task_at(bag, "nearest"), small.options())
    assert len(rows) == 4
    assert all(row.errors and np.isfinite(row.errors["all"].epe_m) for row in rows)
