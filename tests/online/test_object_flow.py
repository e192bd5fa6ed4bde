# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online estimator on a street of boxes, one of which drives while the sensor does, too."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from box_street import pose, stamp_ns, triplets_of, unrelated_sweep
from driving_car import FAST, STREET, is_of_car, of_car, path, sweep, truth

from mnsf_ros.core.flow_estimate import Effort
from mnsf_ros.errors import CancelledError, SweepError
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start, Sweep, SweepTriplet

# The boxes have fewer points than real objects.
SETTINGS = Settings().changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})


def drive(*indices, **how):
    return [sweep(index, **how) for index in indices]


def triplet(*indices, **how):
    return SweepTriplet(*drive(*indices, **how))


def estimate(triplet, **changes):
    return ObjectFlowEstimator(SETTINGS.changed(changes)).estimate(triplet)


def assert_right(result, current, index, next_index, velocity=FAST):
    """Flow, mask and motion over ground are right to a few centimetres."""
    car, known = of_car(current), result.over_ground
    flow, motion = truth(index, next_index, current, velocity)
    # What of the car is lower than 0.4 m may count as ground or not.
    rest = ~is_of_car(current)
    assert known.dynamic[car].all()
    assert known.dynamic[rest].mean() < 0.01
    errors_m = np.linalg.norm(result.flow - flow, axis=1)
    assert errors_m[car].max() < 0.05
    assert errors_m[rest].mean() < 0.02
    np.testing.assert_allclose(known.motion[car], motion[car], atol=0.04)
    assert not known.motion[~known.dynamic].any()
    assert np.isfinite(result.flow).all()
    assert ((known.confidence >= 0) & (known.confidence <= 1)).all()


@pytest.mark.parametrize(
    "velocity",
    [FAST, (0.3, 0, 0), (-1.2, 0.1, 0), (2.5, 0, 0), (0.0, 0.15, 0)],
    ids=["as fast", "slow", "oncoming", "very fast", "crossing"],
)
def test_ego_motion_and_one_car_are_told_apart(velocity):
    current = sweep(1, velocity)
    result = estimate(SweepTriplet(sweep(0, velocity), current, sweep(2, velocity)))
    assert_right(result, current, 1, 2, velocity)
    assert result.over_ground.source == "registration"


def test_each_triplet_of_a_drive_from_a_warm_start():
    estimator, starts = ObjectFlowEstimator(SETTINGS), []
    for index, each in enumerate(triplets_of(drive(*range(7))), start=1):
        result = estimator.estimate(each)
        assert_right(result, each.current, index, index + 1)
        expected = np.linalg.inv(path(0)) @ path(index)
        np.testing.assert_allclose(result.over_ground.world_from_sensor, expected, atol=0.02)
        starts.append(result.start)
    assert starts == [Start.COLD_FIRST] + 4 * [Start.WARM]


@pytest.mark.parametrize("indices", [(0, 1, 3), (0, 2, 3), (0, 1, 1.5)])
def test_unequal_intervals(indices):
    each = triplet(*indices)
    assert_right(estimate(each), each.current, *indices[1:])


def test_without_stamps_the_intervals_are_taken_for_equal():
    sweeps = [Sweep(each.xyz) for each in drive(0, 1, 2)]
    result = estimate(SweepTriplet(*sweeps))
    assert_right(result, sweeps[1], 1, 2)
    assert result.start is Start.COLD_FIRST


@pytest.mark.parametrize("place", [(12, 0), (-12, 0), (0, -3.4), (2, -3.4), (-2, 3.4)])
def test_cars_that_drive_along_at_the_speed_of_the_sensor_are_movers(place):
    sweeps = [
        STREET.sweep(pose(0.6 * index), index, cars=[np.add(place, (0.6 * index, 0))])
        for index in range(7)
    ]
    estimator = ObjectFlowEstimator(SETTINGS)
    for one in triplets_of(sweeps):
        result = estimator.estimate(one)
        car = of_car(one.current)
        assert result.over_ground.dynamic[car].mean() > 0.95
    np.testing.assert_allclose(result.flow[car].mean(axis=0), 0, atol=0.05)


def test_after_a_failed_registration_the_sweep_before_it_is_no_witness():
    estimator, sweeps = ObjectFlowEstimator(SETTINGS), drive(*range(6))
    # Nothing of the street, so that neither it nor the sweep after it can be registered.
    sweeps[3] = unrelated_sweep(3)
    results = [estimator.estimate(each) for each in triplets_of(sweeps)]
    sources = [result.over_ground.source for result in results]
    assert sources == ["registration", *(2 * ["lost"]), "registration"]
    for result in results[1:3]:
        assert not result.over_ground.confidence.any()
    assert ["backward" in result.times_ms for result in results] == [
        True,
        True,
        False,
        False,
    ]
    assert_right(results[3], sweeps[4], 4, 5)


def test_nothing_moves_on_a_street_without_the_car():
    sweeps = [STREET.sweep(path(index), index) for index in range(3)]
    known = estimate(SweepTriplet(*sweeps)).over_ground
    assert known.dynamic.mean() < 0.01


def test_ground_walls_and_nothing_else():
    """No object at all: fewer points than any object needs, and a wall too long for one."""
    ground = np.random.default_rng(0).uniform((-30, -10, -1.8), (30, 10, -1.8), (3000, 3))
    wall = np.stack(np.meshgrid(np.arange(-20, 20, 0.2), 8, np.arange(-1.5, 1, 0.3)), -1)
    xyz = np.vstack([ground, wall.reshape(-1, 3)]).astype(np.float32)
    result = estimate(SweepTriplet(*(Sweep(xyz, stamp_ns(index)) for index in range(3))))
    assert not result.over_ground.dynamic.any()
    # Nothing holds the sensor along the wall but the pattern of its points.
    np.testing.assert_allclose(result.flow, 0, atol=0.02)


def points(num_points):
    angles = np.linspace(0, 2 * np.pi, num_points, endpoint=False)
    return np.stack([10 * np.cos(angles), 10 * np.sin(angles), 0 * angles], 1).astype(np.float32)


@pytest.mark.parametrize("num_points", [10, 60])
def test_very_few_points(num_points):
    sweeps = [Sweep(points(num_points), stamp_ns(index)) for index in range(3)]
    result = estimate(SweepTriplet(*sweeps), **{"ground.remove": False})
    np.testing.assert_allclose(result.flow, 0, atol=1e-6)
    # They are too sparse for surfaces.
    assert result.over_ground.source == "lost"


@pytest.mark.parametrize("num_points", [0, 1, 9])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_too_few_points_are_refused_and_the_next_triplet_is_fine(num_points, place):
    estimator, sweeps = ObjectFlowEstimator(SETTINGS), drive(0, 1, 2)
    sweeps[place] = Sweep(points(num_points), stamp_ns(place), "lidar")
    text = rf"^{sweeps[place]}: \d of {num_points} points are left"
    with pytest.raises(SweepError, match=text):
        estimator.estimate(SweepTriplet(*sweeps))
    each = triplet(3, 4, 5)
    assert_right(estimator.estimate(each), each.current, 4, 5)


@pytest.mark.parametrize("far", [1e3, 1e6, 1e20, 3e38])
def test_points_at_huge_coordinates_do_no_harm(far):
    corners = np.array(list(itertools.product((-far, 0, far), repeat=3)), np.float32)
    sweeps = [
        Sweep(np.vstack([corners, each.xyz]), each.stamp_ns, each.frame_id)
        for each in drive(0, 1, 2)
    ]
    result = estimate(SweepTriplet(*sweeps))
    plain = estimate(triplet(0, 1, 2))
    np.testing.assert_allclose(result.flow[27:], plain.flow, atol=0.03)
    assert not np.isnan(result.over_ground.confidence).any()
    assert not result.over_ground.dynamic[:27].any()


def test_estimate_can_be_abandoned_before_each_step_and_the_next_one_is_fine():
    each, estimator = triplet(0, 1, 2), ObjectFlowEstimator(SETTINGS)
    num_steps = len(estimate(each).times_ms)
    assert num_steps >= 7
    for allowed in range(num_steps):
        answers = iter([False] * allowed + [True])
        with pytest.raises(CancelledError):
            estimator.estimate(each, lambda answers=answers: next(answers))
    later = triplet(1, 2, 3)
    assert_right(estimator.estimate(later), later.current, 2, 3)


def test_with_less_effort_older_sweeps_and_suspects_are_left_out():
    triplets = list(triplets_of(drive(*range(10))))
    usual, hasty = ObjectFlowEstimator(SETTINGS), ObjectFlowEstimator(SETTINGS)
    for number, each in enumerate(triplets):
        effort = Effort.LEAST if number == 5 else Effort.FULL
        wanted, found = usual.estimate(each), hasty.estimate(each, effort=effort)
        reason = found.reason_of(np.flatnonzero(of_car(each.current)))
        num_sweeps = len(reason.sweeps)
        if number < 5:
            np.testing.assert_array_equal(found.flow, wanted.flow)
        elif number == 5:
            assert (found.effort, num_sweeps) == (Effort.LEAST, 2)
            assert_right(found, each.current, number + 1, number + 2)
    assert (found.effort, num_sweeps) == (Effort.FULL, 4)


class TestManyMovers:
    CARS = tuple((x, -2.0) for x in (-16, -8, 8, 16))

    def triplet(self, first=0, **how):
        def at(index):
            cars = [(x + 0.6 * index, y) for x, y in self.CARS]
            return STREET.sweep(pose(0.2 * index), index, cars=cars)

        return SweepTriplet(at(first), at(first + 1), at(first + 2), **how)

    def moving_share(self, result):
        """Of each car the share of points that are said to move."""
        cars = result.over_ground.dynamic[-1600:].reshape(4, 400)
        return cars.mean(axis=1)

    def test_the_nearest_ones_are_looked_at_and_the_others_counted(self):
        # Parts of a long thing at 8 m, seen by few points, are among them.
        result = estimate(self.triplet())
        assert (self.moving_share(result) > 0.8).all()
        assert result.num_left_out == 0
        result = estimate(self.triplet(), **{"objects.max_suspects": 6})
        np.testing.assert_array_equal(self.moving_share(result) > 0.5, [False, True, True, False])
        assert result.num_left_out >= 2
        # Nobody looked whether they move: that they stand is doubtful, as of all suspects.
        left_out = result.over_ground.confidence[-1600:].reshape(4, 400)[[0, 3]]
        assert (np.median(left_out, axis=1) < 0.9).all()

    def test_those_with_a_track_are_looked_at_before_nearer_ones(self):
        estimator = ObjectFlowEstimator(SETTINGS)
        for first in range(3):
            estimator.estimate(self.triplet(first))
        # As if the place had filled up since.
        estimator.settings = SETTINGS.changed({"objects.max_suspects": 16})
        result = estimator.estimate(self.triplet(3))
        assert result.num_left_out > 0
        assert (self.moving_share(result) > 0.5).all()

    def test_faster_than_the_fastest_object_none_is_found(self):
        each = self.triplet()
        result = estimate(each, **{"objects.max_speed_m_s": 1.0})
        # The cars move by 0.6 m, which fits reach from where the search ends.
        assert np.linalg.norm(result.over_ground.motion, axis=1).max() < 0.15
        assert not result.over_ground.dynamic.any()


def test_under_a_ceiling_a_car_is_no_part_of_the_walls():
    def beneath(current):
        x, y = np.mgrid[-20:20:0.2, -8:8:0.2].reshape(2, -1)
        ceiling = np.stack([x, y, np.full(len(x), 3.0)], axis=1).astype(np.float32)
        return replace(current, xyz=np.concatenate([current.xyz, ceiling]))

    current = sweep(1)
    result = estimate(SweepTriplet(*map(beneath, drive(0, 1, 2))))
    assert result.over_ground.dynamic[: len(current)][of_car(current)].all()
    assert not result.over_ground.dynamic[len(current) :].any()
    assert not result.kept[len(current) :].any()


def test_a_road_on_a_dam_has_ground_far_below_and_still_objects():
    def on_a_dam(current):
        x, y = np.mgrid[-60:60:0.4, 5:60:0.4].reshape(2, -1)
        fields = np.stack([np.tile(x, 2), np.append(y, -y), np.full(2 * len(x), -7.8)], axis=1)
        return replace(current, xyz=np.concatenate([current.xyz, fields.astype(np.float32)]))

    current = sweep(1)
    result = estimate(SweepTriplet(*map(on_a_dam, drive(0, 1, 2))))
    assert result.over_ground.dynamic[: len(current)][of_car(current)].mean() > 0.9
