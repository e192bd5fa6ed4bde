"""The table of columns: a row is all that a new field of the output needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.core.flow_columns import FLOW_COLUMNS, flow_columns
from mnsf_ros.core.flow_estimate import FlowEstimate

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
