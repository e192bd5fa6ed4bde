# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The table of columns: a row is all that a new field of the output needs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.core.flow_columns import FLOW_COLUMNS, chosen_columns, flow_columns
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.settings import OutputSettings

ROOT = Path(__file__).resolve().parents[2]


def test_documents_have_the_same_table():
    documents = "\n".join(path.read_text() for path in sorted((ROOT / "docs").glob("*.md")))
    for column in FLOW_COLUMNS:
        missing = "NaN" if np.isnan(column.missing) else f"{column.missing:g}"
        cells = (
            f"`{column.name}`",
            np.dtype(column.dtype).name,
            column.unit or "-",
            column.text,
            missing,
        )
        assert f"| {' | '.join(cells)} |" in documents


def test_flow_alone_leaves_the_others_missing():
    estimate = FlowEstimate(np.ones((2, 3), np.float32), np.ones(2, bool))
    columns = flow_columns(estimate, 0.1, np.array([True, False, True]))
    np.testing.assert_array_equal(columns["flow_y"], np.float32([1, np.nan, 1]))
    assert np.isnan(columns["vx"]).all()
    assert np.isnan(columns["confidence"]).all()
    assert columns["dynamic"].tolist() == [0, 0, 0]


@pytest.mark.parametrize("column", FLOW_COLUMNS, ids=lambda column: column.name)
def test_columns_have_the_type_that_is_told(column):
    estimate = FlowEstimate(np.ones((2, 3), np.float32), np.ones(2, bool))
    assert flow_columns(estimate, 0.1, np.ones(2, bool))[column.name].dtype == column.dtype


def test_speed_is_that_of_the_velocity_and_colours_need_no_ego_motion():
    motion = np.array([[0.3, 0.4, 0], [0, 0, 0], [np.nan, 0, 0]], np.float32)
    known = OverGround(
        motion, np.ones(3, bool), np.ones(3, np.float32), np.eye(4), np.eye(4), "registration"
    )
    flow = np.ones((3, 3), np.float32)
    estimate = FlowEstimate(flow, np.ones(3, bool), over_ground=known)
    columns = flow_columns(estimate, 0.1, np.ones(3, bool))
    np.testing.assert_allclose(columns["speed"], [5, 0, np.nan], rtol=1e-6)
    colors = columns["rgb"].view(np.uint32)
    assert colors[0] != colors[1] == colors[2]
    assert np.isfinite(columns["rgb"]).all()
    of_flow = flow_columns(replace(estimate, over_ground=None), 0.1, np.ones(3, bool))["rgb"]
    assert len(set(of_flow.view(np.uint32).tolist())) == 1
    assert of_flow.view(np.uint32)[0] != colors[1]
    assert not flow_columns(estimate, 0.0, np.ones(3, bool))["rgb"].any()


def test_chosen_columns():
    names = {
        name: [column.name for column in chosen_columns(settings)]
        for name, settings in (
            ("full", OutputSettings()),
            ("plain", OutputSettings(rgb=False)),
            ("compact", OutputSettings(layout="compact")),
        )
    }
    assert names["full"] == [*names["plain"], "rgb"]
    assert names["compact"] == ["flow_x", "flow_y", "flow_z", "dynamic"]
