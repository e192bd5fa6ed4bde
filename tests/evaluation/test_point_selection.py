from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.evaluation.options import PointSelection
from mnsf_ros.settings import CropSettings, GroundSettings

CROP = CropSettings(min_range_m=1.0, max_range_m=10.0, min_height_m=-2.0, max_height_m=3.0)
KEEP_GROUND = GroundSettings(remove=False)


def cloud(num_points=200, seed=0):
    random = np.random.default_rng(seed)
    return random.uniform(-12, 12, (num_points, 3)).astype(np.float32)


def test_points_outside_the_crop_are_neither_given_nor_scored():
    xyz = np.array([[0.5, 0, 0], [5, 0, 0], [11, 0, 0], [5, 0, 4], [5, 0, -3]], np.float32)
    selection = PointSelection(CROP, KEEP_GROUND)
    scored = selection.scored_mask(xyz, None)
    assert scored.tolist() == [False, True, False, False, False]
    assert selection.given_rows(scored, 1).tolist() == [1]


def test_true_ground_flag_decides_where_there_is_truth():
    xyz = np.array([[5, 0, 0], [6, 0, 0]], np.float32)
    ground = np.array([True, False])
    assert PointSelection(CROP).scored_mask(xyz, ground).tolist() == [False, True]
    kept = PointSelection(CROP, KEEP_GROUND).scored_mask(xyz, ground)
    assert kept.tolist() == [True, True]


def test_ground_is_found_as_the_node_does_without_truth_or_when_asked():
    xyz = np.array([[x, y, 0.0] for x in range(2, 7) for y in range(-3, 4)], np.float32)
    xyz = np.vstack([xyz, np.array([[4.0, 0.0, 1.5]], np.float32)])
    lying = np.zeros(len(xyz), dtype=bool)
    expected = [False] * (len(xyz) - 1) + [True]
    assert PointSelection(CROP).scored_mask(xyz, None).tolist() == expected
    asked = PointSelection(CROP, use_true_ground=False)
    assert asked.scored_mask(xyz, lying).tolist() == expected


def test_choice_is_random_but_always_the_same():
    scored = np.ones(1000, dtype=bool)
    selection = PointSelection(num_points=100, seed=3)
    rows = selection.given_rows(scored, 17)
    assert len(set(rows.tolist())) == 100
    assert np.all(np.diff(rows) > 0)
    assert np.array_equal(rows, selection.given_rows(scored, 17))
    assert not np.array_equal(rows, selection.given_rows(scored, 18))
    other_seed = PointSelection(num_points=100, seed=4)
    assert not np.array_equal(rows, other_seed.given_rows(scored, 17))
    # From all of the sweep, not from a part of it.
    assert rows.min() < 100
    assert rows.max() >= 900


@pytest.mark.parametrize("num_points", [None, 5, 6])
def test_small_sweeps_are_given_whole(num_points):
    scored = np.array([True, False, True, True, False, True, True])
    rows = PointSelection(num_points=num_points).given_rows(scored, 1)
    assert rows.tolist() == [0, 2, 3, 5, 6]


def test_chosen_points_are_among_those_that_are_scored():
    xyz = cloud()
    selection = PointSelection(CROP, KEEP_GROUND, num_points=20)
    scored = selection.scored_mask(xyz, None)
    assert scored[selection.given_rows(scored, 5)].all()


def test_live_node_gets_everything():
    scored = np.array([True, False, True])
    assert PointSelection(gives_all=True).given_rows(scored, 1).tolist() == [0, 1, 2]
