# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.evaluation.examples import kept_points
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.settings import Settings

CROP = {
    "crop.min_range_m": 1.0,
    "crop.max_range_m": 10.0,
    "crop.min_height_m": -2.0,
    "crop.max_height_m": 3.0,
}
KEEP_GROUND = {**CROP, "ground.remove": False}
# All of the points below are kept, but for their number.
WIDE = {"crop.min_range_m": 0.0, "ground.remove": False}


def kept(xyz, changes, true_ground=None, stamp_ns=1, **values):
    options = EvaluationOptions(Settings().changed(changes), **values)
    return kept_points(xyz, stamp_ns, true_ground, options)


def cloud(num_points=200, seed=0):
    random = np.random.default_rng(seed)
    return random.uniform(-1, 1, (num_points, 3)).astype(np.float32)


def test_points_outside_the_crop_do_not_count():
    xyz = np.array([[0.5, 0, 0], [5, 0, 0], [11, 0, 0], [5, 0, 4], [5, 0, -3]], np.float32)
    assert kept(xyz, KEEP_GROUND).tolist() == [False, True, False, False, False]


def test_true_ground_flag_decides_where_there_is_truth():
    xyz = np.array([[5, 0, 0], [6, 0, 0]], np.float32)
    ground = np.array([True, False])
    assert kept(xyz, CROP, ground).tolist() == [False, True]
    assert kept(xyz, KEEP_GROUND, ground).tolist() == [True, True]


def test_ground_is_found_as_the_node_does_without_truth_or_when_asked():
    xyz = np.array([[x, y, 0.0] for x in range(2, 7) for y in range(-3, 4)], np.float32)
    xyz = np.vstack([xyz, np.array([[4.0, 0.0, 1.5]], np.float32)])
    lying = np.zeros(len(xyz), dtype=bool)
    expected = [False] * (len(xyz) - 1) + [True]
    assert kept(xyz, CROP).tolist() == expected
    assert kept(xyz, CROP, lying, ground="settings").tolist() == expected


def test_choice_is_random_but_always_the_same():
    xyz = cloud(1000)
    rows = np.flatnonzero(kept(xyz, WIDE, stamp_ns=17, num_points=100, seed=3))
    assert len(rows) == 100
    again = np.flatnonzero(kept(xyz, WIDE, stamp_ns=17, num_points=100, seed=3))
    assert np.array_equal(rows, again)
    for other in ({"stamp_ns": 18, "seed": 3}, {"stamp_ns": 17, "seed": 4}):
        assert not np.array_equal(rows, np.flatnonzero(kept(xyz, WIDE, num_points=100, **other)))
    # From all of the sweep, not from a part of it.
    assert rows.min() < 100
    assert rows.max() >= 900


@pytest.mark.parametrize("num_points", [None, 5, 6])
def test_of_small_sweeps_all_points_count(num_points):
    assert kept(cloud(5), WIDE, num_points=num_points).all()


def test_chosen_points_are_among_those_that_could_be():
    xyz = 12 * cloud()
    chosen = kept(xyz, KEEP_GROUND, num_points=20)
    assert np.count_nonzero(chosen) == 20
    assert kept(xyz, KEEP_GROUND)[chosen].all()
