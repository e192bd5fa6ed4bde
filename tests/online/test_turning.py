# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online estimator on a street of boxes where a car drives straight or turns."""

import numpy as np
import pytest
from box_street import CAR, BoxStreet, box_points, pose, stamp_ns
from small_scenes import SETTINGS as SMALL
from small_scenes import moved_by, objects_of, prepared, surface, table_of, target

from mnsf_ros.core.reason import Verdict
from mnsf_ros.geometry.rigid_motion import rigid_flow, transformed
from mnsf_ros.online.motions import TrackPrior
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.target import Targets
from mnsf_ros.online.turning import turns_of, with_turns
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

STREET = BoxStreet()
# The boxes have fewer points than real objects.
SETTINGS = Settings().changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
NUM_CAR_POINTS = 600
CAR_POINTS = box_points(np.random.default_rng(7), (0, 0), CAR, NUM_CAR_POINTS)
STRAIGHT, TURNING = (0.8, 0.0), (0.5, 6.0)


def path(index):
    return pose(0.6 * index, yaw_deg=1.0 * index)


def car_pose(index, motion):
    """World_from_car: metres ahead and degrees to the left in each sweep."""
    step = pose(motion[0], yaw_deg=motion[1])
    return pose(8.0, -2.0) @ np.linalg.matrix_power(step, index)


def sweep(index, motion):
    xyz = STREET.xyz(path(index), index)
    world = transformed(CAR_POINTS.astype(np.float32), car_pose(index, motion))
    sensor_from_world = np.linalg.inv(path(index))
    car = transformed(world - np.float32((0, 0, 1.8)), sensor_from_world)
    return Sweep(np.vstack([xyz, car]).astype(np.float32), stamp_ns(index), "lidar")


def drive(motion, number):
    """The estimates of a drive, and the mean errors of each over the car, metres."""
    estimator = ObjectFlowEstimator(SETTINGS)
    for index in range(1, number + 1):
        sweeps = (sweep(index + step, motion) for step in (-1, 0, 1))
        triplet = SweepTriplet(*sweeps)
        estimate = estimator.estimate(triplet)
        yield estimate, error_of_car(estimate, triplet.current, index, motion)


def error_of_car(estimate, current, index, motion):
    there = np.linalg.inv(path(index + 1)) @ car_pose(index + 1, motion)
    back = np.linalg.inv(car_pose(index, motion)) @ path(index)
    lift = pose(z=-1.8)
    car = current.xyz[-NUM_CAR_POINTS:]
    expected = rigid_flow(car, lift @ there @ back @ np.linalg.inv(lift))
    error = np.linalg.norm(estimate.flow[-NUM_CAR_POINTS:] - expected, axis=1)
    # Above what counts as ground.
    return error[car[:, 2] > -1.3].mean()


@pytest.mark.parametrize(("motion", "limit_m"), [(STRAIGHT, 0.01), (TURNING, 0.07)])
def test_finds_how_a_car_moves_and_turns(motion, limit_m):
    estimates, car = zip(*drive(motion, 8), strict=True)
    # How it turns is known once it was seen.
    assert max(car[1:]) < limit_m
    assert car[0] < 0.12
    found = max(estimates[-1].over_ground.objects, key=lambda each: each.num_points)
    assert found.turn_rate == pytest.approx(np.radians(motion[1]) / 0.1, abs=0.2)
    # It turns about the vertical axis, and stays as it is.
    known = estimates[-1].over_ground
    assert np.ptp(known.motion[known.dynamic][:, 2]) < 0.02


@pytest.mark.parametrize("of_track", [0, 1])
def test_fragment_without_a_track_does_not_stop_the_turn_of_its_group(of_track):
    sides = [surface((x, 0.0, 0.0), size=(0.6, 0.6, 1.0), num_points=12) for x in (9.5, 10.5)]
    turn = pose(10.0) @ pose(yaw_deg=8.0) @ np.linalg.inv(pose(10.0))
    current = prepared(*sides)
    after = prepared(*(transformed(each, turn) for each in sides))
    objects = objects_of(current)
    prior = TrackPrior.without_tracks(2).put(
        np.array([of_track]), shares=0.9, turn_rates=np.radians(80.0)
    )
    motions = np.zeros((2, 3), np.float32)
    scene = Scene(current, Targets([target(after, current)], []), 0.1, SMALL.objects)
    table = table_of(objects, prior, fitted=moved_by(motions), verdicts=Verdict.DYNAMIC, groups=0)
    found = turns_of(with_turns(table, scene).linear_motions)
    assert np.degrees(found) == pytest.approx(8.0, abs=0.5)
