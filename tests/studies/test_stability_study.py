# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Replacing points: an estimator whose change is exactly one over N shows a slope of -1."""

import math
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.presets import preset
from mnsf_ros.studies.stability_study import changes, fitted_slope
from mnsf_ros.studies.study import CaseStudySettings, StudyOptions
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


@pytest.fixture
def changes_of(tmp_path):
    """Replaces points with an estimator."""

    def changes_with(estimator, triplet, sizes="100,300,900", repeats=40):
        case = CaseStudySettings(sizes=sizes, repeats=repeats)
        options = StudyOptions(tmp_path, EvaluationOptions(preset("paper")), [], case=case)
        return list(changes("mean", estimator, triplet, options))

    return changes_with


def test_mean_falls_with_one_over_the_number_of_points(triplet, changes_of):
    found = pd.DataFrame(changes_of(MeanFlow(), triplet))
    for sweep in ("current", "next"):
        means = found[found["sweep"] == sweep].groupby("num_points")["flow_m"].mean()
        slope, _ = fitted_slope(means)
        assert slope == pytest.approx(-1.0, abs=0.15)
    unused = found[found["sweep"] == "previous"]
    assert (unused[["flow_m", "loss_m"]] == 0).all(axis=None)


def test_only_one_point_is_another_one_and_points_keep_their_times(triplet, changes_of):
    names = ("current", "next", "previous")
    sweeps = {name: getattr(triplet, name) for name in names}
    timed = {
        name: replace(sweep, times_s=sweep.xyz[:, 0], kept=sweep.xyz[:, 1] > 0)
        for name, sweep in sweeps.items()
    }
    seen = []

    class Watching(MeanFlow):
        def estimate(self, triplet):
            seen.append(triplet)
            return super().estimate(triplet)

    changes_of(Watching(), replace(triplet, **timed), "20,30,50", 1)
    usual, *others = seen[-4:]
    for name, other in zip(names, others, strict=True):
        for sweep in names:
            pair = (getattr(usual, sweep).xyz, getattr(other, sweep).xyz)
            num_changed = np.count_nonzero((pair[0] != pair[1]).any(axis=1))
            assert num_changed == (sweep == name)
            np.testing.assert_array_equal(getattr(other, sweep).times_s, pair[1][:, 0])
            assert getattr(other, sweep).kept.all()


def test_too_few_points_are_refused(triplet, changes_of):
    text = "sizes: got 3000, but the current sweep has 3000 points, expected more"
    with pytest.raises(EvaluationError, match=re.escape(text)):
        changes_of(MeanFlow(), triplet, "10,20,3000", 1)


@pytest.mark.parametrize(
    ("means", "slope", "deviation"),
    [
        ({10: 1.0, 100: 0.1, 1000: 0.01}, -1.0, 0.0),
        ({10: 1.0, 100: 0.1}, -1.0, math.nan),
        ({10: 1.0, 100: 0.0}, math.nan, math.nan),
        ({}, math.nan, math.nan),
    ],
)
def test_slope_of_known_lines(means, slope, deviation):
    line = fitted_slope(pd.Series(means, dtype=float))
    assert line[0] == pytest.approx(slope, nan_ok=True)
    assert line[1] == pytest.approx(deviation, nan_ok=True, abs=1e-6)
