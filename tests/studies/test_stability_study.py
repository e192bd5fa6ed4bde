# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Replacing points: an estimator whose change is exactly one over N shows a slope of -1."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import EvaluationError
from mnsf_ros.studies.stability_study import Change, changes, fitted_slope, mean_changes
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet


class MeanFlow:
    """All points go from the mean of the current to that of the next sweep."""

    def estimate(self, triplet):
        way = triplet.next.xyz.mean(axis=0) - triplet.current.xyz.mean(axis=0)
        flow = np.tile(way, (len(triplet.current), 1)).astype(np.float32)
        return FlowEstimate(flow, np.ones(len(flow), bool))


@pytest.fixture(scope="module")
def triplet():
    random = np.random.default_rng(0)
    sweeps = [
        Sweep(random.uniform(-20, 20, (3000, 3)).astype(np.float32), stamp_ns=10**8 * number)
        for number in range(3)
    ]
    return SweepTriplet(*sweeps)


def found_with(triplet, sizes=(100, 300, 900), num_repeats=40, seed=0):
    return list(changes("mean", MeanFlow(), triplet, sizes, num_repeats, seed))


def test_mean_falls_with_one_over_the_number_of_points(triplet):
    found = found_with(triplet)
    for sweep in ("current", "next"):
        slope, _ = fitted_slope(mean_changes(found, "mean", sweep, "flow_m"))
        assert slope == pytest.approx(-1.0, abs=0.15)
    assert all(c.flow_m == 0 and c.loss_m == 0 for c in found if c.sweep == "previous")


def test_same_seed_gives_the_same_changes(triplet):
    once, again = (found_with(triplet, (50,), 2) for _ in range(2))
    assert once == again
    assert once != found_with(triplet, (50,), 2, seed=1)


def test_only_one_point_is_another_one(triplet):
    seen = []

    class Watching(MeanFlow):
        def estimate(self, triplet):
            seen.append(triplet)
            return super().estimate(triplet)

    list(changes("mean", Watching(), triplet, (50,), 1, 0))
    usual, *others = seen
    for name, other in zip(("current", "next", "previous"), others, strict=True):
        for sweep in ("current", "next", "previous"):
            pair = (getattr(usual, sweep).xyz, getattr(other, sweep).xyz)
            num_changed = np.count_nonzero((pair[0] != pair[1]).any(axis=1))
            assert num_changed == (sweep == name)


def test_too_few_points_are_refused(triplet):
    text = "sizes: got 3000, but the current sweep has 3000 points, expected more"
    with pytest.raises(EvaluationError, match=re.escape(text)):
        found_with(triplet, (3000,), 1)


@pytest.mark.parametrize(
    ("means", "slope", "deviation"),
    [
        ({10: 1.0, 100: 0.1, 1000: 0.01}, -1.0, 0.0),
        ({10: 1.0, 100: 0.1}, -1.0, math.nan),
        ({1: 2.0, 4: 4.0, 16: 8.0}, 0.5, 0.0),
        ({10: 1.0, 100: 0.0}, math.nan, math.nan),
        ({}, math.nan, math.nan),
    ],
)
def test_slope_of_known_lines(means, slope, deviation):
    line = fitted_slope(means)
    assert line[0] == pytest.approx(slope, nan_ok=True)
    assert line[1] == pytest.approx(deviation, nan_ok=True, abs=1e-6)


def test_means_are_over_draws():
    found = [
        Change("a", 10, "next", 0, 1.0, 0.0),
        Change("a", 10, "next", 1, 3.0, 0.0),
        Change("a", 10, "current", 0, 9.0, 0.0),
        Change("b", 10, "next", 0, 9.0, 0.0),
    ]
    assert mean_changes(found, "a", "next", "flow_m") == {10: 2.0}


def test_points_keep_their_times(triplet):
    """A sweep of some of its points has as many times as points."""
    sweeps = [
        replace(sweep, times_s=sweep.xyz[:, 0], kept=sweep.xyz[:, 1] > 0)
        for sweep in (triplet.previous, triplet.current, triplet.next)
    ]
    seen = []

    class Watching(MeanFlow):
        def estimate(self, triplet):
            seen.extend([triplet.previous, triplet.current, triplet.next])
            return super().estimate(triplet)

    list(changes("mean", Watching(), SweepTriplet(*sweeps), (50,), 2, 0))
    assert seen
    for sweep in seen:
        np.testing.assert_array_equal(sweep.times_s, sweep.xyz[:, 0])
        assert sweep.kept.all()
