# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Why objects are called dynamic or not, as the estimator itself knows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_street import BoxStreet, pose

from mnsf_ros.core.reason import PointState, Verdict
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

STREET = BoxStreet()
# The boxes have fewer points than real objects.
SETTINGS = Settings().changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
POINTS_PER_CAR = 400


def estimate(**changes):
    """A car drives 0.8 m a sweep; returns the estimate and the rows of its points above 0.4 m."""
    sweeps = [
        STREET.sweep(
            pose(0.6 * index),
            index,
            cars=[np.array([8.0 + 0.8 * index, -2.0])],
            points_per_box=POINTS_PER_CAR,
        )
        for index in range(3)
    ]
    current = sweeps[1]
    is_car = np.arange(len(current)) >= len(current) - POINTS_PER_CAR
    high = current.xyz[:, 2] + 1.8 > 0.4
    estimator = ObjectFlowEstimator(SETTINGS.changed(changes))
    return estimator.estimate(SweepTriplet(*sweeps)), np.flatnonzero(is_car & high), current


def test_mover_has_its_motion_and_residuals():
    result, car, _ = estimate()
    reason = result.reason_of(car)
    assert reason.verdict is Verdict.DYNAMIC
    assert reason.motion == pytest.approx([0.8, 0.0, 0.0], abs=0.05)
    assert [one.age_s for one in reason.sweeps] == pytest.approx([0.1, -0.1])
    for one in reason.sweeps:
        assert one.moving.residual_m < 0.05 < one.static.residual_m
        assert one.moving.share(PointState.HIT) > 0.5 > one.static.share(PointState.HIT)
        assert len(one.static.positions) == len(one.static.states) > 10
    assert reason.num_points > 10
    assert 1 < reason.size_m < 6
    assert all(np.isfinite(value) for value in reason.evidence.values())


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"objects.max_size_m": 1.0}, Verdict.TOO_LARGE),
        ({"objects.min_points": 1000}, Verdict.TOO_FEW_POINTS),
    ],
)
def test_lost_mover_has_the_step_that_lost_it(changes, verdict):
    result, car, _ = estimate(**changes)
    reason = result.reason_of(car)
    assert (reason.verdict, reason.motion) == (verdict, None)


def test_static_things_and_ground_are_no_suspects():
    result, car, current = estimate()
    rows = np.flatnonzero(np.arange(len(current)) < car[0])
    verdicts = {result.reason_of(rows[place:][:1]).verdict for place in range(0, len(rows), 97)}
    assert Verdict.NOT_SUSPECTED in verdicts
    assert Verdict.DYNAMIC not in verdicts


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, Verdict.GROUND),
        ({"crop.max_range_m": 5.0, "ground.remove": False}, Verdict.OUTSIDE_CROP),
        ({"objects.max_height_m": 0.5}, Verdict.TOO_HIGH),
    ],
)
def test_points_of_no_object_have_the_cause(changes, verdict):
    result, car, current = estimate(**changes)
    is_high = current.xyz[:, 2] > 0.0
    rows = np.flatnonzero(~result.kept & (is_high == (verdict is Verdict.TOO_HIGH)))
    assert len(rows) > 5
    assert result.reason_of(rows).verdict is verdict
    assert result.reason_of(car[:0]).verdict is Verdict.NO_OBJECT


def test_object_that_is_dynamic_only_with_another_one_names_it():
    result, car, current = estimate()
    reasons = result.reason_of
    owners = reasons.scene.current.object_ids()
    numbers = reasons.table.points.numbers
    leader = int(np.flatnonzero(numbers == np.bincount(owners[car]).argmax())[0])
    follower = (leader + 1) % len(numbers)
    table = reasons.table.put(np.array([leader, follower]), groups=0, verdicts=Verdict.DYNAMIC)
    table = table.put(np.array([follower]), log_odds=-2.0).put(np.array([leader]), log_odds=3.0)
    reasons = replace(reasons, table=table)
    reason = reasons(np.flatnonzero(owners == numbers[follower]))
    assert reason.evidence["probability"] == pytest.approx(0.119, abs=0.001)
    assert reason.leader.probability == pytest.approx(0.953, abs=0.001)
    assert reason.leader.place == pytest.approx(current.xyz[car].mean(axis=0), abs=0.5)
    assert reasons(car).leader is None
