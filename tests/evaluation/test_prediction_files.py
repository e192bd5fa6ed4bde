# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.errors import MnsfError
from mnsf_ros.methods.external_flow import PredictionFiles
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import CloudSource
from msg_utils.point_times import PointTimes

ROWS = np.array([2, 3, 5])
FLOW = np.arange(24, dtype=np.float64).reshape(8, 3)


def source_in(recording):
    measured = np.isin(np.arange(8), ROWS)
    return CloudSource(None, measured, PointTimes(None), recording=recording)


@pytest.fixture
def triplet():
    """A sweep of three points from a cloud of eight."""
    sweeps = [small.sweep(index, 3) for index in range(3)]
    source = source_in("logs/drive")
    return SweepTriplet(sweeps[0], replace(sweeps[1], source=source), sweeps[2])


def estimate(folder, triplet):
    return PredictionFiles(str(folder), Settings()).estimate(triplet)


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
        source = source_in(name)
        found = estimate(
            tmp_path, replace(triplet, current=replace(triplet.current, source=source))
        )
        assert found.flow.dtype == np.float32
        assert np.array_equal(found.flow, expected[ROWS])
        assert found.kept.all()


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
        ({"flow": FLOW[:7]}, r"shape \(7, 3\) of float64, expected \(8, 3\)"),
        ({"flow": FLOW[:, :2]}, r"shape \(8, 2\)"),
        ({"flow": np.full((8, 3), "x")}, "expected .8, 3. numbers"),
        ({"flows": FLOW}, "has no array 'flow'; it has flows"),
        ({"flow": np.full((8, 3), None)}, "cannot be read"),
    ],
)
def test_npz_that_does_not_fit(tmp_path, triplet, arrays, text):
    np.savez(tmp_path / f"{small.stamp(1)}.npz", **arrays)
    assert_refused(tmp_path, triplet, text)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04garbage"])
def test_file_of_something_else(tmp_path, triplet, content):
    (tmp_path / f"{small.stamp(1)}.npz").write_bytes(content)
    assert_refused(tmp_path, triplet, "cannot be read")
