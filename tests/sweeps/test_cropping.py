# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The crop keeps what is inside and on its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import crop_mask

CROP = (
    Settings()
    .changed(
        {
            "crop.min_range_m": 5,
            "crop.max_range_m": 50,
            "crop.min_height_m": -2,
            "crop.max_height_m": 4,
        }
    )
    .crop
)


def kept(*points, crop=CROP):
    return crop_mask(np.array(points, dtype=np.float32).reshape(-1, 3), crop).tolist()


def above(value):
    return float(np.nextafter(np.float32(value), np.float32(np.inf)))


def below(value):
    return float(np.nextafter(np.float32(value), np.float32(-np.inf)))


def test_points_on_the_limits_are_inside():
    # (3, 4) and (30, 40) are exactly 5 and 50 m away.
    assert kept((3, 4, 0), (-30, 40, 0), (0, -5, -2), (50, 0, 4)) == [True] * 4


def test_points_just_beyond_a_limit_are_outside():
    assert kept((below(5), 0, 0), (0, above(50), 0), (9, 0, below(-2)), (9, 0, above(4))) == (
        [False] * 4
    )


def test_range_is_horizontal():
    assert kept((3, 3.9, 4), (49, 0, 4)) == [False, True]


def test_limit_that_is_no_binary_fraction():
    crop = Settings().changed({"crop.min_height_m": 0.1, "crop.max_height_m": 0.7}).crop
    assert kept((9, 0, 0.1), (9, 0, 0.7), crop=crop) == [True, True]


@pytest.mark.parametrize("huge", [1e7, 1e20, 3e38])
def test_huge_coordinates_are_outside(huge):
    assert kept((huge, 0, 0), (-huge, huge, 0), (9, 0, huge), (9, 0, -huge)) == [False] * 4


def test_empty():
    assert kept() == []


def test_same_as_asking_each_point():
    points = np.random.default_rng(0).uniform(-60, 60, (500, 3)).astype(np.float32)
    points[:, 2] /= 10
    expected = [5 <= math.hypot(x, y) <= 50 and -2 <= z <= 4 for x, y, z in points.tolist()]
    assert any(expected)
    assert crop_mask(points, CROP).tolist() == expected
