# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.tracks import CloudRows
from mnsf_ros.methods.prediction_files import PredictionFiles
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

ROWS = np.array([2, 3, 5])
FLOW = np.arange(24, dtype=np.float64).reshape(8, 3)


@pytest.fixture
def triplet():
    """A sweep of three points from a cloud of eight."""
    sweeps = [small.sweep(index, 3) for index in range(3)]
    source = CloudRows(ROWS, 8, "logs/drive")
    return SweepTriplet(sweeps[0], replace(sweeps[1], source=source), sweeps[2])


def estimate(folder, triplet):
    return PredictionFiles(str(folder), Settings()).estimate(triplet)


def write_feather(path, columns):
    feather = pytest.importorskip("pyarrow.feather")
    import pyarrow

    path.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(pyarrow.table(columns), path)


def submission(flow):
    names = ("flow_tx_m", "flow_ty_m", "flow_tz_m")
    columns = {name: flow[:, axis].astype(np.float16) for axis, name in enumerate(names)}
    return {**columns, "is_dynamic": np.zeros(len(flow), bool)}


def test_npz_has_a_row_for_each_point_of_the_cloud(tmp_path, triplet):
    """In the folder, or in that of the recording where several have the same last name."""
    (tmp_path / "logs" / "drive").mkdir(parents=True)
    for folder, flow in ((tmp_path, FLOW), (tmp_path / "logs" / "drive", FLOW + 1)):
        np.savez(folder / f"{small.stamp(1)}.npz", flow=flow)
    for name, expected in (
        ("drive", FLOW),
        ("logs/drive", FLOW + 1),
        ("/logs/drive", FLOW + 1),
        ("../logs/drive", FLOW + 1),
    ):
        source = CloudRows(ROWS, 8, name)
        found = estimate(
            tmp_path, replace(triplet, current=replace(triplet.current, source=source))
        )
        assert found.flow.dtype == np.float32
        assert np.array_equal(found.flow, expected[ROWS])
        assert found.kept.all()


def test_argoverse_2_submission(tmp_path, triplet):
    write_feather(tmp_path / "logs" / "drive" / f"{small.stamp(1)}.feather", submission(FLOW))
    assert np.array_equal(estimate(tmp_path, triplet).flow, FLOW[ROWS])


def test_argoverse_2_submission_with_masks(tmp_path, triplet):
    mask = np.array([True, False, True, False, True, True, False, False])
    name = f"logs/drive/{small.stamp(1)}.feather"
    write_feather(tmp_path / "out" / name, submission(FLOW[mask]))
    write_feather(tmp_path / "masks" / name, {"mask": mask})
    method = f"{tmp_path / 'out'}::{tmp_path / 'masks'}"
    found = PredictionFiles(method, Settings()).estimate(triplet)
    # Of the rows 2, 3 and 5 the second is not in the mask.
    assert found.kept.tolist() == [True, False, True]
    assert np.array_equal(found.flow[found.kept], FLOW[[2, 5]])
    assert np.isnan(found.flow[1]).all()


def assert_refused(tmp_path, triplet, text):
    with pytest.raises(MnsfError, match=text) as caught:
        estimate(tmp_path, triplet)
    assert "\n" not in str(caught.value)


def test_predictions_that_are_not_there(tmp_path, triplet):
    assert_refused(tmp_path / "nowhere", triplet, "there is no such folder of predictions")
    assert_refused("", triplet, "there is no such folder of predictions")
    assert_refused(tmp_path, triplet, f"no prediction for stamp {small.stamp(1)}; expected")


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({"flow": FLOW[:7]}, "has 7 rows, its cloud has 8 points"),
        ({"flow": FLOW[:, :2]}, r"shape \(8, 2\)"),
        ({"flow": np.full((8, 3), "x")}, "expected .N, 3. numbers"),
        ({"flows": FLOW}, "has no array 'flow'; it has flows"),
        ({"flow": np.full((8, 3), None)}, "cannot be read"),
    ],
)
def test_npz_that_does_not_fit(tmp_path, triplet, arrays, text):
    np.savez(tmp_path / f"{small.stamp(1)}.npz", **arrays)
    assert_refused(tmp_path, triplet, text)


@pytest.mark.parametrize(
    ("suffix", "content"), [("npz", b""), ("npz", b"PK\x03\x04garbage"), ("feather", b"x")]
)
def test_file_of_something_else(tmp_path, triplet, content, suffix):
    pytest.importorskip("pyarrow")
    (tmp_path / f"{small.stamp(1)}.{suffix}").write_bytes(content)
    assert_refused(tmp_path, triplet, "cannot be read")


def test_feather_without_the_columns(tmp_path, triplet):
    write_feather(tmp_path / f"{small.stamp(1)}.feather", {"x": [1.0], "y": [2.0]})
    assert_refused(tmp_path, triplet, "has no column flow_tx_m.*it has x, y")
