# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Columns of the output clouds: a row of a table is all that a new field needs."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround, TrackedObject
from mnsf_ros.sweeps_io.flow_columns import (
    FLOW_COLUMNS,
    OBJECT_ROW,
    flow_columns,
    object_columns,
)

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_documents_have_the_same_tables():
    text = (DOCS / "ros_interface.md").read_text()
    flow, objects = (fields(text, f"| field of `~/{topic}` |") for topic in ("flow", "objects"))
    assert flow == {
        column.name: [
            np.dtype(column.dtype).name,
            "NaN" if np.isnan(column.missing) else f"{column.missing:g}",
        ]
        for column in FLOW_COLUMNS
    }
    covariances = [f"`{name}`" for name in OBJECT_ROW.names if name.startswith("cov_")]
    assert f"{covariances[0]}, {covariances[1]}, ... {covariances[-1]}" in text
    kinds = {name: OBJECT_ROW[name].name for name in OBJECT_ROW.names}
    assert {name: cells[0] for name, cells in objects.items()} == {
        name: kind for name, kind in kinds.items() if f"`{name}`" not in covariances[2:-1]
    }


def fields(text, head):
    """Names of the fields in a table to their type and last cell."""
    rows = itertools.takewhile(
        lambda line: line.startswith("|"), text.partition(head)[2].splitlines()[2:]
    )
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    return {name: [own[1], own[-1]] for own in cells for name in re.findall("`([a-z_]+)`", own[0])}


def test_flow_alone_leaves_the_others_missing():
    estimate = FlowEstimate(np.ones((2, 3), np.float32), np.ones(2, bool))
    columns = flow_columns(estimate, 0.1, np.array([True, False, True]))
    np.testing.assert_array_equal(columns["flow_y"], np.float32([1, np.nan, 1]))
    assert np.isnan(columns["vx"]).all()
    assert np.isnan(columns["confidence"]).all()
    assert columns["dynamic"].tolist() == [0, 0, 0]
    for column in FLOW_COLUMNS:
        assert columns[column.name].dtype == column.dtype


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


def tracked(track_id, covariance):
    return TrackedObject(
        track_id=track_id,
        center=np.array([1.0, 2.0, 3.0]),
        size=np.array([4.0, 1.8, 1.5]),
        yaw=0.5,
        velocity=np.array([7.0, 8.0, 9.0]),
        turn_rate=0.25,
        covariance=covariance,
        age_s=1.25,
        num_points=40,
    )


def test_each_object_is_a_row():
    random = np.random.default_rng(0).random((6, 6))
    covariance = random @ random.T
    columns = object_columns([tracked(7, np.eye(6)), tracked(9, covariance)])
    box = ("length", "width", "height", "yaw")
    names = (*"xyz", *box, "vx", "vy", "vz", "turn_rate", "age")
    values = (1, 2, 3, 4, 1.8, 1.5, 0.5, 7, 8, 9, 0.25, 1.25)
    for name, value in zip(names, values, strict=True):
        np.testing.assert_allclose(columns[name], [value, value], rtol=1e-6)
    assert columns["id"].tolist() == [7, 9]
    assert columns["num_points"].tolist() == [40, 40]
    for row, first in enumerate(("x", "y", "z", "vx", "vy", "vz")):
        for column, second in enumerate(("x", "y", "z", "vx", "vy", "vz")[row:], row):
            of_both = [float(row == column), covariance[row, column]]
            np.testing.assert_allclose(columns[f"cov_{first}_{second}"], of_both, rtol=1e-6)
    for objects in ([], [tracked(1, np.eye(6))]):
        for name, values in object_columns(objects).items():
            assert (values.dtype, values.shape) == (OBJECT_ROW[name], (len(objects),))
