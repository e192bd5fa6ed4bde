# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Who comes to stand beside something is another object."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, surface, target

from mnsf_ros.core.reason import Verdict
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.online.splitting import rejoined, split
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
        owners = found.object_ids()[len(FAR) :]
        own, hedge = owners[:300], owners[300:]
        assert np.bincount(own).argmax() == found.num_objects - 1
        # Of the back, which is within 0.25 m of where the hedge was, nobody can tell.
        assert (own == found.num_objects - 1).mean() > 0.7
        assert (hedge == found.num_objects - 1).mean() < 0.02
        assert found.is_short_enough[-1]
        assert found.wholes[-1] == np.bincount(hedge).argmax()
        assert found.num_objects - 1 in objects_of(found).numbers

    def test_one_that_stood_there_before_is_not(self):
        both = np.concatenate([person(1.0), HEDGE])
        found = after([both], both)
        assert found.num_objects == 3

    def test_what_was_hidden_before_is_not(self):
        screen = sheet(5.0, 10.0, 2.0)
        found = after([HEDGE, screen], np.concatenate([person(1.0), HEDGE]))
        assert found.num_objects == 3

    def test_parts_go_back_into_what_moves(self):
        whole = prepared(FAR, coach(0.0))
        found = after([coach(-4.0)], coach(0.0))
        assert (found.wholes != np.arange(found.num_objects)).any()
        joined = rejoined(found, np.zeros(0, np.int64))
        np.testing.assert_array_equal(joined.object_ids(), whole.object_ids())
        np.testing.assert_array_equal(joined.thinned_objects, whole.thinned_objects)
        kept = rejoined(found, np.flatnonzero(found.wholes != np.arange(found.num_objects)))
        np.testing.assert_array_equal(kept.object_ids(), found.object_ids())

    def test_what_is_beside_a_moving_part_stays_apart(self):
        found = after([HEDGE], np.concatenate([person(-3.0), person(3.0), HEDGE]))
        part, other = np.flatnonzero(found.wholes != np.arange(found.num_objects))
        np.testing.assert_array_equal(
            rejoined(found, np.array([part])).object_ids(), found.object_ids()
        )
        whole = rejoined(found, np.array([part, found.wholes[part]])).object_ids()
        assert not np.isin(whole, [part, other]).any()

    def test_the_points_of_a_part_are_those_of_the_whole_too(self):
        points = np.concatenate([person(1.0), HEDGE])
        found, whole = after([HEDGE], points), prepared(FAR, points)
        *of_wholes, of_part = found.counts
        assert of_wholes == whole.counts.tolist()
        assert of_part == (found.thinned_objects == found.num_objects - 1).sum() > 20
        np.testing.assert_array_equal(found.sizes[:-1], whole.sizes)

    def test_a_part_may_be_too_long_to_move(self):
        found = after([], sheet(14.0, 64.0, 0.5))
        assert found.wholes[-1] < found.num_objects - 1
        assert 24.0 < found.sizes[-1] < 30.0
        assert not found.is_short_enough[-1]

    def test_if_most_of_a_thing_is_new_it_is_no_part(self):
        found = after([], sheet(14.0, 8.0, 0.5))
        np.testing.assert_array_equal(found.wholes, np.arange(3))

    def test_no_other_sweep_and_nothing_new(self):
        current = prepared(surface((8.0, 0.0, 0.0)))
        assert split(current, []).num_objects == 2
        assert split(current, [target(current, current)]).num_objects == 2


CAR = surface((10.8, 3.0, -0.2), size=(1.6, 4.2, 1.4), num_points=3000)


class TestShortObjects:
    def test_a_person_beside_a_parked_car_is_another_object(self):
        together = np.concatenate([person(1.0), CAR])
        found = after([CAR], together)
        own, car = np.split(found.object_ids()[len(FAR) :], [300])
        assert np.bincount(own).argmax() == found.num_objects - 1
        assert (car == found.num_objects - 1).mean() < 0.1
        assert found.is_short_enough[[own[0], car[-1]]].all()


def bus(y_m):
    """Its side and its front are seen."""
    front = sheet(0.0, 2.5, 1.0)[:, [1, 0, 2]] + (9.0, y_m + 5.0, 0.0)
    return np.concatenate([sheet(7.75, 10.0, 1.0, y_m), front])


def last_estimate(scenes):
    """The last estimate of a standing sensor that sees these points 0.1 s apart."""
    settings = Settings().changed({"ground.remove": False, "ego_motion.source": "odometry"})
    sweeps = [
        Sweep(points.astype(np.float32), number * 100_000_000, "lidar", odometry=np.eye(4))
        for number, points in enumerate(scenes)
    ]
    estimator = ObjectFlowEstimator(settings)
    for number in range(1, len(sweeps) - 1):
        estimate = estimator.estimate(SweepTriplet(*sweeps[number - 1 : number + 2]))
    return estimate


@pytest.mark.parametrize("body", [bus, coach])
def test_what_is_new_of_a_bus_goes_along_with_it(body):
    over_ground = last_estimate(
        [np.concatenate([body(0.5 * number - 4.0), FAR]) for number in range(10)]
    ).over_ground
    own = len(body(0.0))
    assert over_ground.dynamic[:own].mean() > 0.99
    assert not over_ground.dynamic[own:].any()
    assert np.abs(over_ground.motion[:own].mean(axis=0) - (0, 0.5, 0)).max() < 0.05


@pytest.mark.parametrize(("middle_m", "motion_m"), [(-3.0, 0.3), (-1.0, 0.5), (2.0, 0.5)])
def test_a_bus_that_is_longer_than_the_view_moves_as_its_end_does(middle_m, motion_m):
    def seen(number):
        points = np.concatenate([bus(middle_m + motion_m * number), FAR])
        return points[np.abs(points[:, 1]) < np.tan(np.radians(30)) * points[:, 0]]

    over_ground = last_estimate([seen(number) for number in range(-8, 2)]).over_ground
    own = len(seen(0)) - np.count_nonzero(seen(0)[:, 0] > 20)
    assert over_ground.dynamic[:own].mean() > 0.99
    assert not over_ground.dynamic[own:].any()
    assert np.abs(over_ground.motion[:own].mean(axis=0) - (0, motion_m, 0)).max() < 0.05


def beside(hedge):
    """The last estimate of a person who walks along a hedge."""
    return last_estimate(
        [np.concatenate([person(0.15 * number), hedge, FAR]) for number in range(10)]
    )


@pytest.mark.parametrize("length_m", [16.0, 5.0, 1.4])
def test_a_person_who_walks_along_a_hedge_moves_and_the_hedge_does_not(length_m):
    hedge = sheet(10.4, length_m, 0.5)
    over_ground = beside(hedge).over_ground
    assert over_ground.dynamic[:300].mean() > 0.7
    assert over_ground.dynamic[300:].mean() < 0.01
    moved = over_ground.motion[:300][over_ground.dynamic[:300]]
    assert np.abs(moved.mean(axis=0) - (0, 0.15, 0)).max() < 0.03


def test_what_stands_beside_a_part_of_it_says_so():
    hedge = sheet(10.4, 2.5, 0.5)
    reason_of = beside(hedge).reason_of
    assert reason_of(np.arange(300)).verdict is Verdict.DYNAMIC
    assert reason_of(np.arange(300, 300 + len(hedge))).verdict is Verdict.PARTLY
