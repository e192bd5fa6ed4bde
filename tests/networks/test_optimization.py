# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The Adam loop, on networks that are one table of weights."""

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core.flow_estimate import StopReason
from mnsf_ros.errors import OptimizationError
from mnsf_ros.networks.optimization import Schedule, minimize

GOAL = torch.tensor([1.0, -2.0, 3.0])


class Table(nn.Module):
    """Weights, and nothing that they do."""

    def __init__(self, *shape, device="cpu"):
        super().__init__()
        self.weights = nn.Parameter(torch.zeros(shape, device=device))


def weights_of(table):
    return table.weights.detach()


class Course:
    """Squared distance to the goal, times a factor at some calls; remembers losses and weights."""

    def __init__(self, table, factors=None):
        self._weights = table.weights
        self._factors = factors or {}
        self.losses, self.weights = [], []

    def __call__(self):
        factor = self._factors.get(len(self.losses), 1.0)
        loss = (self._weights - GOAL).square().sum(-1) * factor
        self.losses.append(loss.tolist())
        self.weights.append(self._weights.detach().clone())
        return loss


def minimized(schedule, **options):
    """Table, course and result of a fit from zero to the goal."""
    table = Table(3)
    course = Course(table, **options)
    return table, course, minimize(table, course, schedule)


def test_same_as_adam_of_pytorch():
    table, _, _ = minimized(Schedule(20, 0.3, True, keep_best=False))
    weights = nn.Parameter(torch.zeros(3))
    adam = torch.optim.Adam([weights])
    for iteration in range(20):
        adam.param_groups[0]["lr"] = Schedule(20, 0.3, True).learning_rate_at(iteration)
        adam.zero_grad()
        (weights - GOAL).square().sum().backward()
        adam.step()
    torch.testing.assert_close(weights_of(table), weights.detach())


def test_gradient_in_another_layout_than_its_weights(device):
    goal = torch.arange(6.0, device=device).reshape(2, 3)
    table = Table(2, 3, device=device)
    minimize(
        table,
        lambda: (table.weights.T.contiguous() - goal.T).square().sum(),
        Schedule(400, 0.1, True, keep_best=False),
    )
    torch.testing.assert_close(weights_of(table), goal, atol=0.01, rtol=0)


def test_weights_of_the_lowest_loss_are_kept():
    # Steps far too large: the loss goes up and down.
    table, course, result = minimized(Schedule(40, 0.9))
    best = course.losses.index(min(course.losses))
    assert 0 < best < 39
    assert torch.equal(weights_of(table), course.weights[best])
    assert result.loss_m == course.losses[best]
    table, course, result = minimized(Schedule(40, 0.9, keep_best=False))
    assert result.loss_m == course.losses[-1]


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
    table, calls = Table(1), iter(losses)
    limits = {"patience": patience, "min_delta_m": min_delta_m, "keep_best": keep_best}
    schedule = Schedule(len(losses), 1e-9, **limits)
    result = minimize(table, lambda: table.weights.sum() * 0 + next(calls), schedule)
    assert result.iterations == (stop or len(losses))
    expected = StopReason.CONVERGED if stop else StopReason.ITERATION_LIMIT
    assert result.stop_reason is expected


def test_part_of_the_loss_decides_when_to_stop():
    table = Table(3)
    course = Course(table)
    schedule = Schedule(400, 0.1, patience=4, min_delta_m=0.01)
    result = minimize(table, lambda: (course(), torch.ones(())), schedule)
    assert (result.iterations, result.stop_reason) == (5, StopReason.CONVERGED)
    assert result.loss_m == min(course.losses)


def test_no_step_starts_after_the_deadline_but_the_first():
    table, _, result = minimized(Schedule(100, 0.1, deadline=-math.inf, keep_best=False))
    assert (result.iterations, result.stop_reason) == (1, StopReason.TIME_BUDGET)
    torch.testing.assert_close(weights_of(table), torch.tensor([0.1, -0.1, 0.1]))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_returns_to_the_best_weights_when_the_loss_is_not_finite(bad):
    table, course, result = minimized(Schedule(100, 0.1), factors={3: bad})
    assert (result.iterations, result.stop_reason) == (3, StopReason.NOT_FINITE)
    assert torch.equal(weights_of(table), course.weights[2])
    assert result.loss_m == course.losses[2]


@pytest.mark.parametrize(("first", "keep_best"), [(0, True), (0, False), (3, False)])
@pytest.mark.parametrize("patience", [0, 5])
def test_loss_that_is_not_finite_without_better_weights_to_return_to(first, keep_best, patience):
    schedule = Schedule(10, 0.1, patience=patience, keep_best=keep_best)
    factors = dict.fromkeys(range(first, 10), math.nan)
    with pytest.raises(OptimizationError, match=r"^the loss became nan, expected a finite number"):
        minimized(schedule, factors=factors)


def test_network_without_weights_is_not_optimized():
    table = nn.Identity()
    result = minimize(table, lambda: torch.tensor(0.25), Schedule(100, 0.1))
    assert (result.loss_m, result.iterations) == (0.25, 0)
    assert result.stop_reason is StopReason.CONVERGED
    with pytest.raises(OptimizationError, match=r"^the loss became nan, "):
        minimize(table, lambda: torch.tensor(math.nan), Schedule(100, 0.1))


def test_decay_is_a_cosine_to_zero():
    schedule = Schedule(max_iterations=12, learning_rate=0.4, decay=True)
    # cos 0, 60, 90, 120 and 180 degrees.
    for iteration, rate in {0: 0.4, 4: 0.3, 6: 0.2, 8: 0.1, 12: 0.0}.items():
        assert schedule.learning_rate_at(iteration) == pytest.approx(rate, abs=1e-12)
    constant = Schedule(max_iterations=12, learning_rate=0.4)
    assert {constant.learning_rate_at(iteration) for iteration in range(12)} == {0.4}
