# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Without labels: the truth costs least; neither everything static nor everything dynamic wins."""

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.scoring import true_motion
from mnsf_ros.presets import preset
from mnsf_ros.tuning.judges import ConsistencyJudge, read_halves

SETTINGS = preset("online")


@pytest.fixture(scope="module")
def half(street):
    recording = choose_topics(street, "street")
    return read_halves([recording], EvaluationOptions(SETTINGS))[0]


def the_truth(velocity, _):
    return velocity


WRONG = {
    "everything static": lambda velocity, _: 0 * velocity,
    "everything dynamic": lambda velocity, _: velocity + np.array([0, 2, 0]),
    "twice as fast": lambda velocity, _: 2 * velocity,
    "some ghosts": lambda velocity, xyz: velocity + np.where(xyz[:, :1] > 15, (0, 2, 0), 0),
}


def told(velocity_of):
    """Estimates made of the truth."""

    def estimate(example):
        current = example.triplet.current
        known, _ = true_motion(example, example.truth, np.flatnonzero(example.truth.valid))
        velocity = np.zeros(current.xyz.shape)
        velocity[example.truth.valid] = np.where(known.dynamic[:, None], known.velocity, 0)
        motion = np.float32(velocity_of(velocity, current.xyz) * known.interval_s)
        over_ground = OverGround(
            motion=motion,
            dynamic=np.any(motion != 0, axis=1),
            confidence=np.ones(len(motion), np.float32),
            world_from_sensor=current.odometry,
            next_from_current=np.eye(4),
            source="odometry",
        )
        return FlowEstimate(motion, np.ones(len(motion), bool), over_ground=over_ground)

    return lambda examples, _: map(estimate, examples)


def judged(half, estimates_of):
    """The cost of some estimates, of points that a static world does not explain."""
    judge = ConsistencyJudge(half, SETTINGS, estimates_of=told(WRONG["everything static"]))
    judge.estimates_of = estimates_of
    return judge(SETTINGS)


@pytest.mark.parametrize("wrong", WRONG)
def test_truth_costs_least(half, wrong):
    assert judged(half, told(the_truth)) < 0.95 * judged(half, told(WRONG[wrong]))


def test_giving_up_costs_most(half):
    assert judged(half, lambda examples, _: [None] * len(examples)) == pytest.approx(0.5)


def test_online_is_between_truth_and_nothing(half):
    judge = ConsistencyJudge(half, SETTINGS)
    blind = judge(SETTINGS.changed({"objects.min_points": 1000}))
    assert judge(SETTINGS) < 0.97 * blind


def test_sweeps_that_are_missing_are_not_jumped_over(half):
    (examples,) = half
    judge = ConsistencyJudge([(examples[0], examples[-1])], SETTINGS)
    assert judge(SETTINGS) == 0
