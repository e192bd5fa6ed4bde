# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The Adam loop, on networks that are one table of weights."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core import optimization
from mnsf_ros.core.batches import Batches
from mnsf_ros.core.flow_estimate import StopReason
from mnsf_ros.core.learner import Learner, PartlyJudgedLoss
from mnsf_ros.core.optimization import minimize, minimize_stack
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.errors import CancelledError, OptimizationError

GOALS = torch.tensor([[1.0, -2.0, 3.0], [0.1, 0.1, 0.0]])


class Table(nn.Module):
    """Weights, and nothing that they do."""

    def __init__(self, *shape, device="cpu"):
        super().__init__()
        self.weights = nn.Parameter(torch.zeros(shape, device=device))


def learner_of(*shape, device="cpu", num_networks=1):
    learner = Learner.fresh(Table(*shape, device=device))
    learner.num_networks = num_networks
    return learner


def weights_of(learner):
    return learner.network.weights.detach()


class Course:
    """Squared distance to a goal, times a factor at some calls; remembers losses and weights."""

    def __init__(self, learner, goal=GOALS[0], factors=None):
        self._weights = learner.network.weights
        self._goal = goal.to(self._weights.device)
        self._factors = factors or {}
        self.losses, self.weights = [], []

    def __call__(self):
        factor = self._factors.get(len(self.losses), 1.0)
        loss = (self._weights - self._goal).square().sum(-1) * factor
        self.losses.append(loss.tolist())
        self.weights.append(self._weights.detach().clone())
        return loss


def minimized(schedule, *, keep_best=True, **options):
    """Learner, course and result of a fit from zero to the first goal."""
    learner = learner_of(3)
    course = Course(learner, **options)
    return learner, course, minimize(learner, course, schedule, keep_best=keep_best)


def test_same_as_adam_of_pytorch():
    learner, _, _ = minimized(Schedule(20, 0.3, True), keep_best=False)
    weights = nn.Parameter(torch.zeros(3))
    adam = torch.optim.Adam([weights])
    for iteration in range(20):
        adam.param_groups[0]["lr"] = Schedule(20, 0.3, True).learning_rate_at(iteration)
        adam.zero_grad()
        (weights - GOALS[0]).square().sum().backward()
        adam.step()
    torch.testing.assert_close(weights_of(learner), weights.detach())


def test_gradient_in_another_layout_than_its_weights(device):
    goal = torch.arange(6.0, device=device).reshape(2, 3)
    learner = learner_of(2, 3, device=device)
    minimize(
        learner,
        lambda: (learner.network.weights.T.contiguous() - goal.T).square().sum(),
        Schedule(400, 0.1, True),
        keep_best=False,
    )
    torch.testing.assert_close(weights_of(learner), goal, atol=0.01, rtol=0)


def test_weights_of_the_lowest_loss_are_kept():
    # Steps far too large: the loss goes up and down.
    learner, course, result = minimized(Schedule(40, 0.9))
    best = course.losses.index(min(course.losses))
    assert 0 < best < 39
    assert torch.equal(weights_of(learner), course.weights[best])
    assert result.loss_m == learner.last_loss == course.losses[best]
    learner, course, result = minimized(Schedule(40, 0.9), keep_best=False)
    assert result.loss_m == learner.last_loss == course.losses[-1]


# Losses that a fit meets, and the number of the last one if it stops early.
FALLS = [
    ([8, 7, 6, 5, 4, 3, 2, 1], 1, 0.0, None),
    ([1] * 9, 5, 0.0, 6),
    ([4, 4, 4, 3, 3, 3, 3, 3], 3, 0.0, 7),
    # A fall by the minimum itself is no improvement.
    ([1, 0.75, 0.75, 0.75], 2, 0.25, 3),
    # Small falls add up.
    ([1, 0.875, 0.75, 0.625, 0.5, 0.375, 0.25], 3, 0.25, None),
    ([1, 0.875, 0.75, 0.625, 0.5, 0.375, 0.25], 2, 0.25, 3),
    ([1] * 50, 0, 0.0, None),
]


@pytest.mark.parametrize(("losses", "patience", "min_delta_m", "stop"), FALLS)
@pytest.mark.parametrize("keep_best", [True, False])
def test_early_stopping(losses, patience, min_delta_m, stop, keep_best):
    learner, calls = learner_of(1), iter(losses)
    schedule = Schedule(len(losses), 1e-9, patience=patience, min_delta_m=min_delta_m)
    result = minimize(
        learner,
        lambda: learner.network.weights.sum() * 0 + next(calls),
        schedule,
        keep_best=keep_best,
    )
    assert result.iterations == (stop or len(losses))
    expected = StopReason.CONVERGED if stop else StopReason.ITERATION_LIMIT
    assert result.stop_reason is expected


def test_part_of_the_loss_decides_when_to_stop():
    learner = learner_of(3)
    course = Course(learner)
    schedule = Schedule(400, 0.1, patience=4, min_delta_m=0.01)
    result = minimize(
        learner, lambda: PartlyJudgedLoss(course(), torch.ones(())), schedule, keep_best=True
    )
    assert (result.iterations, result.stop_reason) == (5, StopReason.CONVERGED)
    assert result.loss_m == min(course.losses)


def test_no_step_starts_after_the_deadline_but_the_first():
    learner, _, result = minimized(Schedule(100, 0.1, deadline=-math.inf), keep_best=False)
    assert (result.iterations, result.stop_reason) == (1, StopReason.TIME_BUDGET)
    torch.testing.assert_close(weights_of(learner), torch.tensor([0.1, -0.1, 0.1]))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_returns_to_the_best_weights_when_the_loss_is_not_finite(bad):
    learner, course, result = minimized(Schedule(100, 0.1), factors={3: bad})
    assert (result.iterations, result.stop_reason) == (3, StopReason.NOT_FINITE)
    assert torch.equal(weights_of(learner), course.weights[2])
    assert result.loss_m == learner.last_loss == course.losses[2]


@pytest.mark.parametrize(("first", "keep_best"), [(0, True), (0, False), (3, False)])
@pytest.mark.parametrize("patience", [0, 5])
def test_loss_that_is_not_finite_without_better_weights_to_return_to(first, keep_best, patience):
    schedule, factors = (
        Schedule(10, 0.1, patience=patience),
        dict.fromkeys(range(first, 10), math.nan),
    )
    with pytest.raises(OptimizationError, match=r"^the loss became nan, expected a finite number"):
        minimized(schedule, keep_best=keep_best, factors=factors)


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_cancelled(steps):
    learner = learner_of(3)
    course = Course(learner)
    schedule = Schedule(100, 0.1, cancelled=lambda: len(course.losses) == steps)
    with pytest.raises(CancelledError, match=r"^the estimate was cancelled$"):
        minimize(learner, course, schedule, keep_best=True)
    assert len(course.losses) == steps


def test_learner_carries_the_state_of_its_optimizer():
    twice, once = learner_of(3), learner_of(3)
    assert once.last_loss is None
    for _ in range(2):
        minimize(twice, Course(twice), Schedule(5, 0.1), keep_best=False)
    minimize(once, Course(once), Schedule(10, 0.1), keep_best=False)
    assert torch.equal(weights_of(twice), weights_of(once))


def test_network_without_weights_is_not_optimized():
    learner = Learner.fresh(nn.Identity())
    result = minimize(learner, lambda: torch.tensor(0.25), Schedule(100, 0.1), keep_best=True)
    assert learner.optimizer is None
    assert (result.loss_m, result.iterations) == (0.25, 0)
    assert result.stop_reason is StopReason.CONVERGED
    with pytest.raises(OptimizationError, match=r"^the loss became nan, "):
        minimize(learner, lambda: torch.tensor(math.nan), Schedule(100, 0.1), keep_best=True)


@pytest.fixture(params=[1, 10])
def steps_at_once(request, monkeypatch):
    """Steps between two looks at the losses: those of the CPU, and those of CUDA."""
    monkeypatch.setitem(optimization._STEPS_AT_ONCE, "cpu", request.param)


@pytest.mark.parametrize(
    "schedule",
    [
        Schedule(25, 0.1, decay=True),
        Schedule(400, 0.3, patience=5, min_delta_m=0.05),
        Schedule(400, 0.9, patience=3),
        Schedule(1, 0.1, patience=1),
    ],
)
@pytest.mark.parametrize("keep_best", [True, False])
@pytest.mark.usefixtures("steps_at_once")
def test_each_of_a_stack_ends_as_if_it_were_alone(schedule, keep_best, device):
    stack = learner_of(2, 3, device=device, num_networks=2)
    results = minimize_stack(stack, Course(stack, GOALS), schedule, keep_best=keep_best)
    for goal, result, weights in zip(GOALS, results, weights_of(stack), strict=True):
        alone = learner_of(3)
        expected = minimize(alone, Course(alone, goal), schedule, keep_best=keep_best)
        assert (result.iterations, result.stop_reason) == (
            expected.iterations,
            expected.stop_reason,
        )
        torch.testing.assert_close(weights.cpu(), weights_of(alone))
    assert stack.last_loss == results[0].loss_m


@pytest.mark.usefixtures("steps_at_once")
def test_batches_are_those_that_would_be_drawn_in_turn(device):
    rows = torch.arange(100.0, device=device)[:, None]
    sizes = (7, 5, 0)

    def sources():
        generator = torch.Generator().manual_seed(3)
        return [Batches(rows, size, generator) for size in sizes]

    learner, own = learner_of(1, device=device), sources()
    seen, count = (
        torch.zeros(25, 3, device=device),
        torch.zeros(1, dtype=torch.int64, device=device),
    )

    def loss_of():
        seen.index_copy_(0, count, torch.stack([source.draw().sum() for source in own])[None])
        count.add_(1)
        return learner.network.weights.sum()

    minimize(learner, loss_of, Schedule(25, 0.1), keep_best=False, sources=own)
    others = sources()
    expected = [torch.stack([source.draw().sum() for source in others]) for _ in range(25)]
    assert torch.equal(seen, torch.stack(expected))
