# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Who comes to stand beside something is another object."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, surface, target

from mnsf_ros.objects.object_flow import ObjectFlowEstimator
from mnsf_ros.objects.splitting import split
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet


def sheet(x_m, length_m, height_m, middle_m=0.0):
    """(N, 3) points of a wall across the view."""
    y, z = np.meshgrid(np.arange(-length_m / 2, length_m / 2, 0.05), np.arange(-1, height_m, 0.05))
    return np.stack([np.full(y.size, x_m), y.ravel() + middle_m, z.ravel()], axis=1)


FAR, HEDGE = sheet(30.0, 60.0, 3.0), sheet(10.4, 16.0, 0.5)


def person(y_m):
    """Whose back is 0.15 m before the hedge."""
    return surface((10.0, y_m, -0.1), size=(0.5, 0.5, 1.7))


def coach(y_m):
    return surface((9.0, y_m, 0.5), size=(2.5, 16.0, 3.0), num_points=6000)


def after(past, now):
    """The sweep of some parts, split by an older one of others."""
    current = prepared(FAR, now)
    return split(current, [target(prepared(FAR, *past), current, -3.0)])


class TestSplit:
    def test_a_person_beside_a_hedge_is_another_object_and_may_move(self):
        found = after([HEDGE], np.concatenate([person(1.0), HEDGE]))
        owners = found.objects()[len(FAR) :]
        own, hedge = owners[:300], owners[300:]
        assert np.bincount(own).argmax() == found.num_objects - 1
        # Of the back, which is within 0.25 m of where the hedge was, nobody can tell.
        assert (own == found.num_objects - 1).mean() > 0.7
        assert (hedge == found.num_objects - 1).mean() < 0.01
        assert found.may_move[-1]
        assert np.flatnonzero(found.are_parts).tolist() == [found.num_objects - 1]
        assert found.num_objects - 1 in objects_of(found).numbers

    def test_one_that_stood_there_before_is_not(self):
        both = np.concatenate([person(1.0), HEDGE])
        found = after([both], both)
        assert found.num_objects == 3

    def test_what_was_hidden_before_is_not(self):
        screen = sheet(5.0, 10.0, 2.0)
        found = after([HEDGE, screen], np.concatenate([person(1.0), HEDGE]))
        assert found.num_objects == 3

    def test_a_coach_stays_whole(self):
        found = after([coach(-4.0)], coach(0.0))
        number = np.bincount(found.objects()[len(FAR) :]).argmax()
        assert found.num_objects == 3
        assert found.sizes[number] == pytest.approx(16.0, abs=0.1)
        assert found.may_move[number]
        assert not found.are_parts.any()

    def test_no_other_sweep_and_no_long_object(self):
        current = prepared(surface((8.0, 0.0, 0.0)))
        assert split(current, []).num_objects == 2
        assert split(current, [target(current, current)]).num_objects == 2


CAR = surface((10.8, 3.0, -0.2), size=(1.6, 4.2, 1.4), num_points=3000)


class TestShortObjects:
    def test_a_person_beside_a_parked_car_is_another_object(self):
        together = np.concatenate([person(1.0), CAR])
        found = after([CAR], together)
        own, car = np.split(found.objects()[len(FAR) :], [300])
        assert np.bincount(own).argmax() == found.num_objects - 1
        assert (car == found.num_objects - 1).mean() < 0.05
        assert found.may_move[[own[0], car[-1]]].all()

    def test_the_front_of_a_bus_is_a_part_of_it(self):
        """Its side and its front are seen; it went 1 m, and the front is 2.5 m wide."""

        def bus(y_m):
            front = sheet(0.0, 2.5, 1.0)[:, [1, 0, 2]] + (9.0, y_m + 5.0, 0.0)
            return np.concatenate([sheet(7.75, 10.0, 1.0, y_m), front])

        found = after([bus(-1.0)], bus(0.0))
        assert found.num_objects == 3
        assert not found.are_parts.any()


@pytest.mark.parametrize("length_m", [16.0, 5.0])
def test_a_person_who_walks_along_a_hedge_moves_and_the_hedge_does_not(length_m):
    hedge = sheet(10.4, length_m, 0.5)
    settings = Settings().changed({"ground.remove": False, "ego_motion.source": "odometry"})
    sweeps = [
        Sweep(
            np.concatenate([person(0.15 * number), hedge, FAR]).astype(np.float32),
            number * 100_000_000,
            "lidar",
            odometry=np.eye(4),
        )
        for number in range(10)
    ]
    estimator = ObjectFlowEstimator(settings)
    for number in range(1, 9):
        estimate = estimator.estimate(SweepTriplet(*sweeps[number - 1 : number + 2]))
    over_ground = estimate.over_ground
    assert over_ground.dynamic[:300].mean() > 0.7
    assert over_ground.dynamic[300:].mean() < 0.01
    moved = over_ground.motion[:300][over_ground.dynamic[:300]]
    assert np.abs(moved.mean(axis=0) - (0, 0.15, 0)).max() < 0.03
