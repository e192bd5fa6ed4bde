# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The live methods on a street of boxes, one of which drives while the sensor does, too."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import CAR, BoxStreet, box_points, pose, stamp_ns

from mnsf_ros.geometry.rigid_motion import rigid_flow, transformed
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Start, Stretch, Sweep, SweepTriplet

STREET = BoxStreet()
# The boxes have fewer points than real objects.
SETTINGS = preset("neural").changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
NUM_CAR_POINTS = 600
CAR_POINTS = box_points(np.random.default_rng(7), (0, 0), CAR, NUM_CAR_POINTS)
STRAIGHT, TURNING, PARKED = (0.8, 0.0), (0.5, 6.0), (0.0, 0.0)


def path(index):
    return pose(0.6 * index, yaw_deg=1.0 * index)


def car_pose(index, motion):
    """World_from_car: metres ahead and degrees to the left in each sweep."""
    step = pose(motion[0], yaw_deg=motion[1])
    return pose(8.0, -2.0) @ np.linalg.matrix_power(step, index)


def sweep(index, motion=STRAIGHT, **how):
    xyz = STREET.xyz(path(index), index)
    world = transformed(CAR_POINTS.astype(np.float32), car_pose(index, motion))
    sensor_from_world = np.linalg.inv(path(index))
    car = transformed(world - np.float32((0, 0, 1.8)), sensor_from_world)
    return Sweep(np.vstack([xyz, car]).astype(np.float32), stamp_ns(index), "lidar", **how)


def triplet(index, motion=STRAIGHT, stretch=None):
    made = SweepTriplet(*(sweep(index + step, motion) for step in (-1, 0, 1)))
    return made if stretch is None else replace(made, stretch=stretch)


def drive(motion, number, first=1, method="neural"):
    """The estimates of a drive, and their sweeps' errors over the car and elsewhere, metres."""
    estimator, stretch = make_method(method, SETTINGS), Stretch(Start.COLD_FIRST)
    for index in range(first, first + number):
        each = triplet(index, motion, stretch)
        estimate = estimator.estimate(each)
        yield estimate, *errors(estimate, each.current, index, motion)


def errors(estimate, current, index, motion):
    next_from_current = np.linalg.inv(path(index + 1)) @ path(index)
    expected = rigid_flow(current.xyz, next_from_current)
    there = np.linalg.inv(path(index + 1)) @ car_pose(index + 1, motion)
    back = np.linalg.inv(car_pose(index, motion)) @ path(index)
    lift = pose(z=-1.8)
    car = slice(-NUM_CAR_POINTS, None)
    whole = lift @ there @ back @ np.linalg.inv(lift)
    expected[car] = rigid_flow(current.xyz[car], whole)
    error = np.linalg.norm(estimate.flow - expected, axis=1)
    # Above what counts as ground.
    is_high = current.xyz[:, 2] > -1.3
    return error[car][is_high[car]].mean(), error[:-NUM_CAR_POINTS].mean()


@pytest.mark.parametrize(("motion", "limit_m"), [(STRAIGHT, 0.05), (TURNING, 0.1)])
def test_finds_the_flow_of_a_car_and_goes_on_warm(motion, limit_m):
    estimates, car, static = zip(*drive(motion, 6), strict=True)
    assert max(car[3:]) < limit_m
    assert max(static) < 0.05
    assert [each.start for each in estimates] == [Start.COLD_FIRST] + 5 * [Start.WARM]
    last = estimates[-1]
    assert last.flow.dtype == np.float32
    assert last.over_ground.dynamic[-NUM_CAR_POINTS:].mean() > 0.8
    # The road under the car, at most.
    assert last.over_ground.dynamic[:-NUM_CAR_POINTS].mean() < 0.005
    # What its sparse points do not connect may have a track of its own.
    car = max(last.over_ground.objects, key=lambda each: each.num_points)
    assert car.num_points > 0.83 * np.count_nonzero(last.over_ground.dynamic)
    assert car.age_s > 0.25
    assert {"forward", "backward", "fusion"} < last.times_ms.keys()


@pytest.mark.parametrize(("motion", "limit_m"), [(STRAIGHT, 0.01), (TURNING, 0.07)])
def test_online_finds_how_a_car_moves_and_turns(motion, limit_m):
    estimates, car, _ = zip(*drive(motion, 8, method="online"), strict=True)
    # How it turns is known once it was seen.
    assert max(car[1:]) < limit_m
    assert car[0] < 0.12
    found = max(estimates[-1].over_ground.objects, key=lambda each: each.num_points)
    assert found.turn_rate == pytest.approx(np.radians(motion[1]) / 0.1, abs=0.2)
    # It turns about the vertical axis, and stays as it is.
    known = estimates[-1].over_ground
    assert np.ptp(known.motion[known.dynamic][:, 2]) < 0.02


def test_what_is_parked_is_static():
    for estimate, car_m, static_m in drive(PARKED, 4):
        assert not estimate.over_ground.dynamic[-NUM_CAR_POINTS:].any()
        # Boxes of points that hide nothing: a few are where others were not.
        assert estimate.over_ground.dynamic.mean() < 0.001
        assert max(car_m, static_m) < 0.05


def test_two_sweeps_are_enough():
    each = triplet(1)
    estimate = make_method("neural", SETTINGS).estimate(replace(each, previous=None))
    assert errors(estimate, each.current, 1, STRAIGHT)[0] < 0.1


def test_same_bits_prepared_or_not_and_after_another_stretch():
    expected = [estimate.flow for estimate, *_ in drive(STRAIGHT, 3)]
    estimator = make_method("neural", SETTINGS)
    for _ in range(2):
        stretch = Stretch(Start.COLD_FIRST)
        for index, flow in enumerate(expected, start=1):
            each = triplet(index, STRAIGHT, stretch)
            estimate = estimator.estimate(each, prepared=estimator.prepare(each))
            np.testing.assert_array_equal(estimate.flow, flow)


def test_settings_keep_the_state_that_is_valid():
    stretch = Stretch(Start.COLD_FIRST)
    estimator = make_method("neural", SETTINGS)
    estimator.estimate(triplet(1, stretch=stretch))
    kept = estimator.with_settings(SETTINGS.changed({"warm_start.max_gap_s": 5}))
    assert kept.estimate(triplet(2, stretch=stretch)).start is Start.WARM
    other = kept.with_settings(SETTINGS.changed({"objects.thinning_m": 0.2}))
    assert other.estimate(triplet(3, stretch=stretch)).start is Start.COLD_FIRST
    off = SETTINGS.changed({"warm_start.enabled": False})
    assert other.with_settings(off).estimate(triplet(4)).start is Start.COLD_BY_SETTING
