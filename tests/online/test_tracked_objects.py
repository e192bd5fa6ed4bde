# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Objects of a drive: identity, box, velocity, age, and what is told of hidden ones."""

from __future__ import annotations

import numpy as np
import pytest
from box_street import BoxStreet, box_points, pose, triplets_of

from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

STREET = BoxStreet()
# The boxes have fewer points than real objects.
SETTINGS = Settings().changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
POINTS_PER_CAR = 400
SPEED_M_S = 8.0


def path(index):
    return pose(0.3 * index, yaw_deg=index)


def drive(number, speed_m_s=SPEED_M_S, hidden=()):
    """Sweeps with a car, but for those in which it is hidden."""
    return [
        STREET.sweep(
            path(index),
            index,
            cars=[] if index in hidden else [(-10 + speed_m_s / 10 * index, -2.0)],
            points_per_box=POINTS_PER_CAR,
        )
        for index in range(number)
    ]


def estimates(sweeps, **changes):
    estimator = ObjectFlowEstimator(SETTINGS.changed(changes))
    return [estimator.estimate(each).over_ground for each in triplets_of(sweeps)]


def car_of(known):
    """The object that most of the car's points belong to."""
    ids = known.track_ids[-POINTS_PER_CAR:]
    (car,) = (each for each in known.objects if each.track_id == np.bincount(ids).argmax())
    return car


class TestCar:
    @pytest.fixture(scope="class")
    def all_known(self):
        return estimates(drive(9))

    def test_keeps_its_number(self, all_known):
        assert len({car_of(known).track_id for known in all_known}) == 1

    def test_has_its_box(self, all_known):
        for index, known in enumerate(all_known, start=1):
            car, sensor_from_world = car_of(known), np.linalg.inv(path(index))
            center = sensor_from_world @ (-10 + 0.8 * index, -2.0, 0.75 - 1.8, 1.0)
            np.testing.assert_allclose(car.center, center[:3], atol=0.3)
            np.testing.assert_allclose(car.size, (4.0, 1.8, 1.5), atol=0.35)
            assert car.yaw == pytest.approx(np.radians(-index), abs=0.03)

    def test_has_its_outline(self, all_known):
        for known in all_known:
            corners = car_of(known).outline
            edges, (x, y) = np.roll(corners, -1, axis=0) - corners, corners.T
            (ahead, left), (next_ahead, next_left) = edges.T, np.roll(edges, -1, axis=0).T
            assert (ahead * next_left > next_ahead * left).all()
            area = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
            assert area == pytest.approx(4.0 * 1.8, rel=0.2)

    def test_has_its_velocity(self, all_known):
        for index, known in enumerate(all_known, start=1):
            expected = path(index)[:3, :3].T @ (SPEED_M_S, 0, 0)
            car = car_of(known)
            np.testing.assert_allclose(car.velocity, expected, atol=0.3)
            assert 0 < car.covariance[3, 3] < 1

    def test_numbers_its_points(self, all_known):
        for known in all_known:
            np.testing.assert_array_equal(known.track_ids > 0, known.dynamic)
            for each in known.objects:
                assert each.num_points == np.count_nonzero(known.track_ids == each.track_id)


def test_what_is_faster_than_any_object_is_not_held():
    known = estimates(drive(9), **{"objects.max_speed_m_s": 5.0})
    assert not any(each.dynamic.any() for each in known)


def walk(places):
    """Sweeps with a person at these places, (x, y) each."""
    sweeps = []
    for index, place in enumerate(places):
        still = STREET.sweep(path(index), index)
        body = box_points(np.random.default_rng(1), place, (0.4, 0.5, 1.7), 150)
        sensor_from_world = np.linalg.inv(path(index))
        body = (body - (0, 0, 1.8)) @ sensor_from_world[:3, :3].T + sensor_from_world[:3, 3]
        xyz = np.vstack([still.xyz, body.astype(np.float32)])
        sweeps.append(Sweep(xyz, still.stamp_ns, still.frame_id))
    return sweeps


def found_shares(places):
    """Of each sweep but the first and the last the share of the person that is said to move."""
    return np.array([known.dynamic[-150:].mean() for known in estimates(walk(places))])


class TestPerson:
    @pytest.mark.parametrize("speed_m_s", [0.5, 1.5])
    @pytest.mark.parametrize("heading", [(1.0, 0.0), (0.0, -1.0)])
    def test_is_found_from_six_tenths_of_a_second_on(self, speed_m_s, heading):
        places = np.add(np.outer(np.arange(14) * speed_m_s / 10, heading), (4.0, 3.0))
        assert (found_shares(places)[6:] > 0.8).mean() >= 0.9

    def test_that_stops_is_static_within_half_a_second(self):
        way = np.minimum(np.arange(20), 10) * 0.15
        shares = found_shares(np.stack([4 + way, np.full(20, 3.0)], axis=1))
        assert (shares[6:9] > 0.8).all()
        # It stands from sweep 10 on, which the estimates see as number 9.
        assert (shares[9 + 5 :] == 0).all()


@pytest.mark.parametrize(
    ("place", "speed_m_s", "braking_m_s2", "num_points"),
    [((20.0, -2.0), 5.0, 6.0, 80), ((25.0, -3.0), 6.0, 5.0, 100)],
)
def test_car_that_brakes_is_dynamic_until_it_stands(place, speed_m_s, braking_m_s2, num_points):
    speeds = np.clip(speed_m_s - braking_m_s2 * (np.arange(34) - 8) / 10, 0.0, speed_m_s)
    way = np.concatenate([[0.0], np.cumsum(speeds[:-1])]) / 10
    sweeps = [
        STREET.sweep(path(index), index, cars=[np.add(place, (x, 0))], points_per_box=num_points)
        for index, x in enumerate(way)
    ]
    shares = np.array([known.dynamic[-num_points:].mean() for known in estimates(sweeps)])
    speeds = speeds[1:-1]
    assert (shares[7:][speeds[7:] >= 0.2] > 0.3).all()
    stop = np.flatnonzero(speeds < 0.2)[0]
    assert (shares[stop + 5 :] == 0).all()


class TestIdentity:
    def test_outlasts_a_sweep_in_which_it_is_hidden(self):
        known = estimates(drive(10, hidden=(5,)))
        assert car_of(known[0]).track_id == car_of(known[-1]).track_id
        assert 1 not in known[4].track_ids

    def test_of_a_renewed_estimator_have_other_numbers(self):
        sweeps = drive(8)
        triplets = list(triplets_of(sweeps))
        estimator = ObjectFlowEstimator(SETTINGS)
        first = [estimator.estimate(each).over_ground for each in triplets[:3]]
        other = estimator.renewed(SETTINGS)
        later = car_of(other.estimate(triplets[3]).over_ground).track_id
        assert later not in {each.track_id for known in first for each in known.objects}


class TestOddInput:
    def assert_sound(self, known):
        for each in known.objects:
            numbers = (each.center, each.size, each.velocity, each.covariance, each.yaw)
            assert all(np.isfinite(number).all() for number in numbers)
            assert each.age_s >= 0

    def test_without_stamps(self):
        estimator = ObjectFlowEstimator(SETTINGS)
        sweeps = [Sweep(each.xyz) for each in drive(3)]
        for _ in range(2):
            known = estimator.estimate(SweepTriplet(*sweeps)).over_ground
            self.assert_sound(known)
            # What stamps do not tell counts as the usual interval.
            assert np.linalg.norm(car_of(known).velocity) == pytest.approx(SPEED_M_S, abs=0.3)
            assert car_of(known).age_s == 0

    def test_same_triplet_again(self):
        estimator, triplets = ObjectFlowEstimator(SETTINGS), list(triplets_of(drive(5)))
        for number in (0, 1, 1, 0, 2):
            self.assert_sound(estimator.estimate(triplets[number]).over_ground)

    @pytest.mark.parametrize("interval_ns", [1, 10**6, 2 * 10**9 - 1])
    def test_odd_intervals(self, interval_ns):
        sweeps = [Sweep(each.xyz, interval_ns * i, "lidar") for i, each in enumerate(drive(5))]
        for known in estimates(sweeps):
            self.assert_sound(known)
