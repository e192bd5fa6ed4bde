# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.ground import ground_hits
from mnsf_ros.simulation.street import CURB_HEIGHT_M, ROAD_HALF_WIDTH_M, Centerline, Street

STRAIGHT = Street(Centerline(0.0, 100.0, 0.0), -100.0, 100.0, ())
ORIGIN = np.array([0.0, 0.0, 1.7])


def toward(target):
    ray = np.asarray(target, dtype=float) - ORIGIN
    return (ray / np.linalg.norm(ray))[None]


@pytest.mark.parametrize(
    ("target", "surface"),
    [
        ((5.0, 0.0, 0.0), SurfaceClass.ROAD),
        ((-30.0, 6.0, 0.0), SurfaceClass.ROAD),
        ((4.0, 9.0, CURB_HEIGHT_M), SurfaceClass.SIDEWALK),
        ((2.0, -8.0, CURB_HEIGHT_M), SurfaceClass.SIDEWALK),
        ((3.0, ROAD_HALF_WIDTH_M, 0.07), SurfaceClass.SIDEWALK),
        ((3.0, -ROAD_HALF_WIDTH_M, 0.1), SurfaceClass.SIDEWALK),
    ],
    ids=["road", "road behind", "left walk", "right walk", "left curb", "right curb"],
)
def test_ray_ends_where_it_was_aimed(target, surface):
    ranges, classes = ground_hits(STRAIGHT, ORIGIN, toward(target), 120.0)
    assert ranges[0] == pytest.approx(np.linalg.norm(np.array(target) - ORIGIN), abs=2e-3)
    assert classes[0] == surface


@pytest.mark.parametrize("target", [(5.0, 0.0, 1.7), (5.0, 0.0, 3.0), (130.0, 0.0, 0.0)])
def test_level_rising_and_too_long_rays_miss(target):
    ranges, classes = ground_hits(STRAIGHT, ORIGIN, toward(target), 120.0)
    assert ranges[0] == np.inf
    assert classes[0] == 0
