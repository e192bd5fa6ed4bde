# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The ground that objects will cover."""

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.sweeps_io.predicted_ground import predicted_columns


def car(velocity=(10.0, 0.0, 0.0), *, turn_rate=0.0, deviations=(0.0, 0.0), number=3):
    """A car 4 m long and 2 m wide that looks ahead, 10 m ahead of the sensor."""
    covariance = np.diag(np.repeat(np.square(deviations), 3))
    center, size = np.array([10.0, 0.0, 0.5]), np.array([4.0, 2.0, 1.5])
    return TrackedObject(
        number, center, size, 0.0, np.array(velocity), turn_rate, covariance, 1.0, 100
    )


def ground_of(*objects, horizon_s=2.0):
    columns = predicted_columns(objects, horizon_s)
    return np.stack([columns["x"], columns["y"]], axis=1), columns


HALF_CELL_M = 0.1


def is_covered(ground, x, y):
    """Whether a place is in a cell of the ground."""
    return (np.abs(ground - (x, y)).max(axis=1) <= HALF_CELL_M + 1e-5).any()


def assert_spans(ground, low, high):
    np.testing.assert_allclose(ground.min(axis=0), low, atol=1.01 * HALF_CELL_M)
    np.testing.assert_allclose(ground.max(axis=0), high, atol=1.01 * HALF_CELL_M)


def test_lies_ahead_without_gaps_until_the_horizon():
    ground, columns = ground_of(car())
    assert_spans(ground, (8, -1), (32, 1))
    for x in np.arange(8, 32, 0.1):
        assert is_covered(ground, x, 0.0)
    assert set(columns["z"]) == {np.float32(0.5)}
    assert set(columns["id"]) == {3}
    # When it is there first: its front is 2 m ahead of its middle.
    ahead = columns["ahead"][np.abs(ground[:, 0] - 27) < 0.2]
    assert ahead.min() == pytest.approx(1.5, abs=0.2)
    assert columns["ahead"].max() <= 2.0
    assert (np.diff(columns["ahead"]) >= 0).all()


def test_follows_a_turn():
    # A quarter of a circle of radius 20/pi to the left in 1 s.
    ground, _ = ground_of(car(turn_rate=np.pi / 2), horizon_s=1.0)
    radius_m = 20 / np.pi
    assert ground[:, 1].max() == pytest.approx(radius_m + 2, abs=0.2)
    assert is_covered(ground, 10 + radius_m, radius_m)
    assert is_covered(ground, 10 + radius_m * np.sin(np.pi / 4), radius_m * (1 - np.cos(np.pi / 4)))
    assert not is_covered(ground, 20.0, 0.0)


def test_is_wider_where_the_place_is_less_certain():
    ground, columns = ground_of(car(deviations=(0.3, 0.4)))
    now = np.abs(ground[columns["ahead"] == 0][:, 1]).max()
    assert now == pytest.approx(1.3, abs=0.11)
    # The variances of the place and of its change add up.
    assert np.abs(ground[:, 1]).max() == pytest.approx(1 + np.hypot(0.3, 0.8), abs=0.11)


@pytest.mark.parametrize(("deviation_m_s", "until_s"), [(3.0, 0.5), (300.0, 0.0)])
def test_ends_where_the_place_is_unknown(deviation_m_s, until_s):
    # As of an object that was seen for the first time.
    ground, columns = ground_of(car((4.0, 0.0, 0.0), deviations=(0.1, deviation_m_s)))
    assert columns["ahead"].max() == pytest.approx(until_s, abs=0.2)
    assert np.abs(ground[:, 1]).max() < 1 + 1.5 + HALF_CELL_M
    assert len(ground_of(car(deviations=(300.0, 1.0)))[0]) == 0


def test_has_one_point_in_a_cell_of_the_object_that_comes_first():
    ground, columns = ground_of(car((5.0, 0.0, 0.0)), car(number=7))
    cells = np.floor(ground / 0.2).astype(int)
    assert len(np.unique(cells, axis=0)) == len(cells)
    assert set(columns["id"][ground[:, 0] > 25]) == {7}
    assert set(columns["id"][np.abs(ground[:, 0] - 10) < 1]) == {3}


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (80.0, 0.0, 0.0), (0.0, 30.0, 0.0)])
def test_covers_all_of_the_way_at_any_speed(velocity):
    ground, _ = ground_of(car(velocity), horizon_s=1.0)
    for share in np.linspace(0, 1, 200):
        assert is_covered(ground, 10 + share * velocity[0], share * velocity[1])


def test_is_the_place_now_without_a_horizon_and_nothing_without_objects():
    ground, _ = ground_of(car(), horizon_s=0.0)
    assert_spans(ground, (8, -1), (12, 1))
    assert len(ground_of()[0]) == 0
