# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The table of what is said of an object: a row is all that a new field of `~/objects` needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.core.object_columns import OBJECT_COLUMNS, object_columns

ROOT = Path(__file__).resolve().parents[2]


def tracked(track_id, covariance):
    return TrackedObject(
        track_id=track_id,
        center=np.array([1.0, 2.0, 3.0]),
        size=np.array([4.0, 1.8, 1.5]),
        yaw=0.5,
        velocity=np.array([7.0, 8.0, 9.0]),
        covariance=covariance,
        age_s=1.25,
        num_points=40,
    )


def test_documents_have_the_same_table():
    documents = "\n".join(path.read_text() for path in sorted((ROOT / "docs").glob("*.md")))
    for column in OBJECT_COLUMNS:
        if not column.name.startswith("cov_"):
            kind = np.dtype(column.dtype).name
            cells = (f"`{column.name}`", kind, column.unit or "-", column.text)
            assert f"| {' | '.join(cells)} |" in documents
    of_covariance = [f"`{item.name}`" for item in OBJECT_COLUMNS if item.name.startswith("cov_")]
    assert f"{of_covariance[0]}, {of_covariance[1]}, ... {of_covariance[-1]}" in documents


def test_each_object_is_a_row():
    random = np.random.default_rng(0).random((6, 6))
    covariance = random @ random.T
    columns = object_columns([tracked(7, np.eye(6)), tracked(9, covariance)])
    expected = {
        "id": [7, 9],
        "x": [1, 1],
        "y": [2, 2],
        "z": [3, 3],
        "length": [4, 4],
        "width": [1.8, 1.8],
        "height": [1.5, 1.5],
        "yaw": [0.5, 0.5],
        "vx": [7, 7],
        "vy": [8, 8],
        "vz": [9, 9],
        "age": [1.25, 1.25],
        "num_points": [40, 40],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(columns[name], values, rtol=1e-6)
    for row, first in enumerate(("x", "y", "z", "vx", "vy", "vz")):
        for column, second in enumerate(("x", "y", "z", "vx", "vy", "vz")[row:], row):
            of_both = [float(row == column), covariance[row, column]]
            np.testing.assert_allclose(columns[f"cov_{first}_{second}"], of_both, rtol=1e-6)


@pytest.mark.parametrize("column", OBJECT_COLUMNS, ids=lambda column: column.name)
def test_columns_have_the_type_that_is_told(column):
    for objects in ([], [tracked(1, np.eye(6))]):
        values = object_columns(objects)[column.name]
        assert (values.dtype, values.shape) == (column.dtype, (len(objects),))
