# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The Adam loop, on networks that are one vector of weights."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core.optimization import Learner, StopReason, minimize
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.errors import CancelledError, MnsfError, OptimizationError


class Vector(nn.Module):
    """Three weights, and nothing that they do."""

    def __init__(self, start=(0.0, 0.0, 0.0)):
        super().__init__()
        self.weights = nn.Parameter(torch.tensor(start))


class Course:
    """A loss that remembers each call: squared distance to a goal, unless told otherwise."""

    def __init__(self, learner, goal=(1.0, -2.0, 3.0), instead=None):
        self._weights = learner.network.weights
        self._goal = torch.tensor(goal)
        self._instead = instead or {}
        self.losses, self.weights = [], []

    def __call__(self):
        loss = (self._weights - self._goal).square().sum()
        factor = self._instead.get(len(self.losses), 1.0)
        self.losses.append((loss * factor).item())
        self.weights.append(self._weights.detach().clone())
        return loss * factor


def learner_at(start=(0.0, 0.0, 0.0)):
    return Learner.fresh(Vector(start))


def weights_of(learner):
    return learner.network.weights.detach()


@pytest.mark.parametrize("keep_best", [True, False])
@pytest.mark.parametrize("decay", [True, False])
def test_finds_the_minimum(keep_best, decay):
    learner = learner_at()
    course = Course(learner)
    result = minimize(learner, course, Schedule(400, 0.1, decay), keep_best=keep_best)
    torch.testing.assert_close(
        weights_of(learner), torch.tensor([1.0, -2.0, 3.0]), atol=0.01, rtol=0
    )
    assert result.loss_m < 1e-3
    assert (result.iterations, result.stop_reason) == (400, StopReason.ITERATION_LIMIT)


def test_weights_of_the_lowest_loss_are_kept():
    # Steps far too large: the loss goes up and down.
    learner = learner_at()
    course = Course(learner)
    result = minimize(learner, course, Schedule(40, 0.9), keep_best=True)
    best = course.losses.index(min(course.losses))
    assert 0 < best < 39
    assert torch.equal(weights_of(learner), course.weights[best])
    assert result.loss_m == learner.last_loss == course.losses[best]


def test_last_weights_are_kept_where_losses_cannot_be_compared():
    learner = learner_at()
    course = Course(learner)
    result = minimize(learner, course, Schedule(40, 0.9), keep_best=False)
    assert result.loss_m == learner.last_loss == course.losses[-1]
    assert not any(torch.equal(weights_of(learner), weights) for weights in course.weights)


@pytest.mark.parametrize("decay", [True, False])
def test_each_step_has_the_size_of_the_schedule(decay):
    # Under a constant gradient, each step of Adam is as long as the learning rate.
    learner = learner_at()
    schedule = Schedule(10, 0.5, decay)
    minimize(learner, learner.network.weights.sum, schedule, keep_best=False)
    way = sum(schedule.learning_rate_at(iteration) for iteration in range(10))
    torch.testing.assert_close(weights_of(learner), torch.full((3,), -way), rtol=1e-4, atol=0)


def test_stops_when_converged():
    learner = learner_at()
    result = minimize(
        learner,
        Course(learner, goal=(0.0, 0.0, 0.0)),
        Schedule(100, 0.1, patience=7),
        keep_best=True,
    )
    assert (result.iterations, result.stop_reason) == (8, StopReason.CONVERGED)


@pytest.mark.parametrize("keep_best", [True, False])
def test_fall_below_min_delta_counts_as_converged(keep_best):
    schedule = Schedule(100, 0.1, patience=7, min_delta_m=1000.0)
    learner = learner_at()
    result = minimize(learner, Course(learner), schedule, keep_best=keep_best)
    assert (result.iterations, result.stop_reason) == (8, StopReason.CONVERGED)


def test_no_step_starts_after_the_deadline_but_the_first():
    learner = learner_at()
    course = Course(learner)
    schedule = Schedule(100, 0.1, deadline=-math.inf)
    result = minimize(learner, course, schedule, keep_best=False)
    assert (result.iterations, result.stop_reason) == (1, StopReason.TIME_BUDGET)
    torch.testing.assert_close(weights_of(learner), torch.tensor([0.1, -0.1, 0.1]))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_returns_to_the_best_weights_when_the_loss_is_not_finite(bad):
    learner = learner_at()
    course = Course(learner, instead={3: bad})
    result = minimize(learner, course, Schedule(100, 0.1), keep_best=True)
    assert (result.iterations, result.stop_reason) == (3, StopReason.NOT_FINITE)
    assert torch.equal(weights_of(learner), course.weights[2])
    assert result.loss_m == learner.last_loss == course.losses[2]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("keep_best", [True, False])
@pytest.mark.parametrize("patience", [0, 5])
def test_loss_that_was_never_finite(bad, keep_best, patience):
    learner = learner_at()
    course = Course(learner, instead=dict.fromkeys(range(10), bad))
    with pytest.raises(
        OptimizationError, match=r"^the loss became (nan|inf), expected a finite number of metres$"
    ):
        minimize(learner, course, Schedule(10, 0.1, patience=patience), keep_best=keep_best)


@pytest.mark.parametrize("patience", [0, 5])
def test_loss_that_stays_not_finite_without_better_weights_to_return_to(patience):
    learner = learner_at()
    course = Course(learner, instead={3: math.nan})
    with pytest.raises(OptimizationError, match=r"^the loss became nan, "):
        minimize(learner, course, Schedule(10, 0.1, patience=patience), keep_best=False)


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_cancelled(steps):
    learner = learner_at()
    course = Course(learner)
    schedule = Schedule(100, 0.1, cancelled=lambda: len(course.losses) == steps)
    with pytest.raises(CancelledError, match=r"^the estimate was cancelled$"):
        minimize(learner, course, schedule, keep_best=True)
    assert len(course.losses) == steps


def test_errors_have_one_root():
    assert issubclass(OptimizationError, MnsfError)
    assert issubclass(CancelledError, MnsfError)


def test_learner_carries_the_state_of_its_optimizer():
    twice, once = learner_at(), learner_at()
    for _ in range(2):
        minimize(twice, Course(twice), Schedule(5, 0.1), keep_best=False)
    minimize(once, Course(once), Schedule(10, 0.1), keep_best=False)
    assert torch.equal(weights_of(twice), weights_of(once))


def test_network_without_weights_is_only_looked_at():
    learner = Learner.fresh(nn.Identity())
    result = minimize(learner, lambda: torch.tensor(0.25), Schedule(100, 0.1), keep_best=True)
    assert learner.optimizer is None
    assert (result.loss_m, result.iterations) == (0.25, 0)
    assert result.stop_reason is StopReason.CONVERGED


def test_network_without_weights_and_a_loss_that_is_not_finite():
    learner = Learner.fresh(nn.Identity())
    with pytest.raises(OptimizationError, match=r"^the loss became nan, "):
        minimize(learner, lambda: torch.tensor(math.nan), Schedule(100, 0.1), keep_best=True)


def test_fresh_learner_has_no_loss():
    assert learner_at().last_loss is None
