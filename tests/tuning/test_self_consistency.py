# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Without labels: the truth costs least; neither everything static nor everything dynamic wins."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.scoring import true_motion
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings
from mnsf_ros.tuning.judges import Half, read_halves
from mnsf_ros.tuning.self_consistency import ConsistencyJudge

SETTINGS = preset("online")


@pytest.fixture(scope="module")
def half(street):
    recording = choose_topics(street, "street")
    return read_halves([recording], EvaluationOptions(SETTINGS), 40)[0]


def the_truth(velocity, _):
    return velocity


WRONG = {
    "everything static": lambda velocity, _: 0 * velocity,
    "everything dynamic": lambda velocity, _: velocity + np.array([0, 2, 0]),
    "twice as fast": lambda velocity, _: 2 * velocity,
    "some ghosts": lambda velocity, xyz: velocity + np.where(xyz[:, :1] > 15, (0, 2, 0), 0),
}


@dataclass(frozen=True, eq=False)
class Told(Half):
    """A half whose estimates are made of the truth."""

    velocity_of: Callable = WRONG["everything static"]

    def estimated(self, _: Settings) -> Iterator:
        return (map(self.estimate, stretch) for stretch in self.stretches)

    def estimate(self, example):
        current = example.triplet.current
        known, _ = true_motion(example, example.truth, np.flatnonzero(example.truth.valid))
        velocity = np.zeros(current.xyz.shape)
        velocity[example.truth.valid] = np.where(known.dynamic[:, None], known.velocity, 0)
        motion = np.float32(self.velocity_of(velocity, current.xyz) * known.interval_s)
        over_ground = OverGround(
            motion=motion,
            dynamic=np.any(motion != 0, axis=1),
            confidence=np.ones(len(motion), np.float32),
            world_from_sensor=current.odometry,
            next_from_current=np.eye(4),
            source="odometry",
        )
        return example, FlowEstimate(motion, np.ones(len(motion), bool), over_ground=over_ground)


class Failing(Told):
    """A method that gives up."""

    def estimate(self, example):
        return example, None


def judged(half, velocity_of, kind=Told):
    judge = ConsistencyJudge(Told(half.stretches), SETTINGS)
    judge.half = kind(half.stretches, velocity_of)
    return judge(SETTINGS)


@pytest.mark.parametrize("wrong", WRONG)
def test_truth_costs_least(half, wrong):
    assert judged(half, the_truth) < 0.95 * judged(half, WRONG[wrong])


def test_giving_up_costs_most(half):
    assert judged(half, the_truth, Failing) == pytest.approx(0.5)


def test_online_is_between_truth_and_nothing(half):
    judge = ConsistencyJudge(half, SETTINGS)
    blind = judge(SETTINGS.changed({"objects.min_points": 1000}))
    assert judge(SETTINGS) < 0.97 * blind


def test_sweeps_that_are_missing_are_not_jumped_over(half):
    (stretch,) = half.stretches
    judge = ConsistencyJudge(Half(((stretch[0], stretch[-1]),)), SETTINGS)
    assert judge(SETTINGS) == 0
