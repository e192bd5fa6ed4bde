# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What one triplet hands to the next, and when it is dropped."""

from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.errors import CancelledError
from mnsf_ros.methods import make_method
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start, Sweep, SweepTriplet

SMALL = Settings().changed(
    {
        "compute.device": "cpu",
        "ground.remove": False,
        "field.num_hidden_layers": 1,
        "field.hidden_width": 8,
        "fusion.num_hidden_layers": 1,
        "fusion.hidden_width": 8,
        "optimization.max_iterations": 5,
        "optimization.time_budget_ms": 0,
        "warm_start.time_budget_ms": 0,
        "fusion.max_iterations": 4,
        "warm_start.max_iterations": 3,
        "warm_start.max_gap_s": 2,
        "warm_start.max_loss_ratio": 1000,
    }
)
POINTS = np.random.default_rng(0).uniform((2, 2, -1), (8, 8, 1), (60, 3))


def triplet(seconds, points=POINTS):
    """A triplet whose current sweep has this stamp. Its points stand still."""
    return SweepTriplet(
        *(
            Sweep.from_array(points, stamp_ns=round((seconds + step) * 1e9))
            for step in (-0.1, 0, 0.1)
        )
    )


def starts(estimator, *triplets):
    return [estimator.estimate(each).start for each in triplets]


@pytest.fixture
def estimator():
    """An estimator with one triplet behind it, at 10 s."""
    estimator = make_method("mnsf", SMALL)
    assert starts(estimator, triplet(10)) == [Start.COLD_FIRST]
    return estimator


def test_warm_start_has_its_own_number_of_steps(estimator):
    fits = estimator.estimate(triplet(10.1)).fits
    assert {stage: fit.iterations for stage, fit in fits.items()} == {
        "forward": 3,
        "backward": 3,
        "fusion": 3,
    }


def test_warm_start_carries_on_where_the_last_triplet_ended(make_scene):
    # The same motion goes on: three steps do after a warm start what they cannot from scratch.
    scene = make_scene()
    many = SMALL.changed(
        {
            "field.hidden_width": 64,
            "field.num_hidden_layers": 3,
            "fusion.kind": "mean",
            "ground.remove": True,
            "optimization.max_iterations": 150,
        }
    )
    few = many.changed({"optimization.max_iterations": 3})

    def at(seconds):
        sweeps = zip((-0.1, 0, 0.1), (scene.previous, scene.current, scene.next), strict=True)
        return SweepTriplet(
            *(Sweep.from_array(xyz, stamp_ns=round((seconds + s) * 1e9)) for s, xyz in sweeps)
        )

    def error(estimate):
        return np.linalg.norm(estimate.flow - scene.flow, axis=1)[scene.moving].mean()

    estimator = make_method("mnsf", many)
    estimator.estimate(at(10))
    warm, cold = estimator.estimate(at(10.1)), make_method("mnsf", few).estimate(at(10.1))
    assert (warm.start, cold.start) == (Start.WARM, Start.COLD_FIRST)
    assert error(warm) < 0.15
    assert error(cold) > 0.4


def test_carried_fields_that_no_longer_fit():
    estimator = make_method("mnsf", SMALL.changed({"optimization.max_iterations": 100}))
    strict = estimator.with_settings(SMALL.changed({"warm_start.max_loss_ratio": 3}))
    assert starts(estimator, triplet(10)) == [Start.COLD_FIRST]
    assert starts(strict, triplet(10.1)) == [Start.WARM]
    jump = SweepTriplet(
        triplet(10.2).previous,
        triplet(10.2).current,
        triplet(10.2, points=np.add(POINTS, (3, -3, 0))).next,
    )
    assert starts(strict, jump) == [Start.COLD_LOSS]


def test_cancelled_estimate_leaves_nothing_to_start_from(estimator):
    with pytest.raises(CancelledError):
        estimator.estimate(triplet(10.1), lambda: True)
    assert starts(estimator, triplet(10.2), triplet(10.3)) == [Start.COLD_FIRST, Start.WARM]


def test_two_sweeps_leave_nothing_to_start_from(estimator):
    pair = SweepTriplet(None, triplet(10.1).current, triplet(10.1).next)
    assert starts(estimator, pair, triplet(10.2)) == [Start.WARM, Start.COLD_FIRST]


@pytest.mark.parametrize(
    ("change", "start"),
    [
        ({"optimization.max_iterations": 7}, Start.WARM),
        ({"warm_start.max_iterations": 7}, Start.WARM),
        ({"ground.remove": True}, Start.WARM),
        ({"distance.kind": "grid"}, Start.WARM),
        ({"field.num_hidden_layers": 2}, Start.COLD_FIRST),
        ({"field.hidden_width": 9}, Start.COLD_FIRST),
        ({"fusion.hidden_width": 9}, Start.COLD_FIRST),
        ({"fusion.kind": "weighted_sum"}, Start.COLD_FIRST),
        ({"compute.seed": 1}, Start.COLD_FIRST),
    ],
)
def test_start_after_other_settings(estimator, change, start):
    points = np.vstack([POINTS, np.add(POINTS, (0, 0, 3))])
    changed = estimator.with_settings(SMALL.changed(change))
    assert starts(changed, triplet(10.1, points)) == [start]


def test_warm_start_switched_off_and_on_again(estimator):
    off = estimator.with_settings(SMALL.changed({"warm_start.enabled": False}))
    assert starts(off, triplet(10.1)) == [Start.COLD_BY_SETTING]
    assert starts(off.with_settings(SMALL), triplet(10.2)) == [Start.WARM]
