# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The robot's own body, on a street of boxes that the sensor drives through."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_street import BoxStreet, box_points, pose, stamp_ns, triplets_of

from mnsf_ros.core.reason import Verdict
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import boxes_around
from mnsf_ros.sweeps.sweep import Sweep

SETTINGS = Settings().changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
STREET = BoxStreet()
NUM_BEHIND = 200
BEHIND_M = np.array([-0.9, 1.1, -0.9])


def behind(index, drift_m):
    """(N, 3) points of a box behind the sensor, which the sensor sees with noise."""
    points = box_points(np.random.default_rng(1), (0, 0), (0.6, 0.3, 0.4), NUM_BEHIND)
    noise = np.random.default_rng(index).normal(0, 0.01, points.shape)
    return points + noise + BEHIND_M + (index * drift_m, index * drift_m, 0)


def sweep(index, step_m=0.5, drift_m=0.0, walls=()):
    """A sweep of the street, its last points those of the box behind the sensor."""
    place = pose(step_m * index, yaw_deg=0.5 * step_m * index)
    street = STREET.xyz(place, seed=1000 + index, points_per_box=200)
    parts = [street, *(wall(index) for wall in walls), behind(index, drift_m)]
    return Sweep(np.concatenate(parts).astype(np.float32), stamp_ns(index), "lidar")


def estimates(number=16, settings=SETTINGS, **how):
    """The estimates of a drive."""
    estimator = ObjectFlowEstimator(settings)
    return [
        estimator.estimate(one) for one in triplets_of([sweep(i, **how) for i in range(number)])
    ]


def test_what_moves_with_the_sensor_for_a_second_is_the_own_body():
    *_, last = estimates()
    own = np.arange(len(last.flow)) >= len(last.flow) - NUM_BEHIND
    assert len(last.own_body) == pytest.approx(NUM_BEHIND, abs=10)
    assert last.own_body_text == f"{len(last.own_body)} points within 1.9 m"
    assert not last.over_ground.dynamic[own].any()
    assert not last.kept[own].any()
    assert np.median(np.abs(last.flow[own])) == 0
    assert last.reason_of(np.flatnonzero(own)).verdict is Verdict.OWN_BODY


def test_until_then_it_may_be_a_mover():
    first, *_ = estimates(3)
    assert len(first.own_body) == 0


@pytest.mark.parametrize("drift_m", [0.02, -0.02])
def test_a_companion_whose_distance_changes_is_a_mover(drift_m):
    *_, last = estimates(20, drift_m=drift_m)
    assert len(last.own_body) < 0.1 * NUM_BEHIND
    assert last.over_ground.dynamic[-NUM_BEHIND:].mean() > 0.5


def test_a_sensor_that_stands_learns_nothing():
    assert all(len(one.own_body) == 0 for one in estimates(step_m=0.0))


def test_a_wall_along_the_way_is_no_body():
    def wall(index):
        along = np.random.default_rng(index).uniform((-20, -1.5, -1.5), (20, -1.5, 0), (4000, 3))
        return along @ pose(yaw_deg=0.25 * index)[:3, :3]

    *_, last = estimates(walls=[wall])
    assert len(last.own_body) <= NUM_BEHIND


@pytest.mark.parametrize("boxes", ["-2 2 -1 0 0 0; 5 5 5 6 6 6", "learned"])
def test_boxes_name_the_body_from_the_first_sweep_on(boxes):
    if boxes == "learned":
        *_, last = estimates()
        boxes = boxes_around(last.own_body)
    boxed = SETTINGS.changed({"crop.own_body": boxes})
    first, *_ = estimates(3, settings=boxed)
    assert len(first.own_body) >= 0.9 * NUM_BEHIND
    assert not first.over_ground.dynamic[-NUM_BEHIND:].any()


def test_the_body_is_not_looked_for_if_not_wanted():
    *_, last = estimates(settings=SETTINGS.changed({"crop.own_body": "none"}))
    assert len(last.own_body) == 0


@pytest.mark.parametrize(("frame_id", "is_known"), [("lidar", True), ("rear", False)])
def test_the_body_stays_known_after_a_break_while_the_frame_stays(frame_id, is_known):
    estimator = ObjectFlowEstimator(SETTINGS)
    for one in triplets_of([sweep(index) for index in range(16)]):
        estimator.estimate(one)
    after = [replace(sweep(index), frame_id=frame_id) for index in range(100, 103)]
    (first,) = (estimator.renewed(SETTINGS).estimate(one) for one in triplets_of(after))
    assert (len(first.own_body) > 0.9 * NUM_BEHIND) == is_known
