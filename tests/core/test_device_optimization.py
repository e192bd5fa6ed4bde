# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The Adam loop that the host does not wait for gives what the other one gives."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.device_optimization import minimize_on_device
from mnsf_ros.core.flow_estimate import StopReason
from mnsf_ros.core.learner import Learner, PartlyJudgedLoss
from mnsf_ros.core.optimization import minimize
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.errors import CancelledError, OptimizationError

GOALS = torch.tensor([[1.0, -2.0, 3.0], [0.1, 0.1, 0.0]])


class Vector(nn.Module):
    """Weights, and nothing that they do."""

    def __init__(self, *shape, device="cpu"):
        super().__init__()
        self.weights = nn.Parameter(torch.zeros(shape, device=device))


def learner_of(*shape, device="cpu", num_networks=1):
    learner = Learner.fresh(Vector(*shape, device=device))
    learner.num_networks = num_networks
    return learner


def distance_to(goal, learner):
    return lambda: (learner.network.weights - goal).square().sum(-1)


SCHEDULES = [
    Schedule(25, 0.1),
    Schedule(25, 0.1, decay=True),
    Schedule(400, 0.3, patience=5, min_delta_m=0.05),
    Schedule(400, 0.9, patience=3),
    Schedule(1, 0.1, patience=1),
]


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize("keep_best", [True, False])
def test_same_as_the_loop_of_the_host(schedule, keep_best):
    by_host, by_device = learner_of(3), learner_of(3)
    expected = minimize(by_host, distance_to(GOALS[0], by_host), schedule, keep_best=keep_best)
    results = minimize_on_device(
        by_device, distance_to(GOALS[0], by_device), schedule, keep_best=keep_best
    )
    (result,) = results
    assert (result.iterations, result.stop_reason) == (expected.iterations, expected.stop_reason)
    # The step sizes are float32 on the device.
    assert result.loss_m == by_device.last_loss == pytest.approx(expected.loss_m, rel=1e-5)
    torch.testing.assert_close(by_device.network.weights, by_host.network.weights)


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize("keep_best", [True, False])
def test_each_of_a_stack_ends_as_if_it_were_alone(schedule, keep_best, device):
    stack = learner_of(2, 3, device=device, num_networks=2)
    goals = GOALS.to(device)
    results = minimize_on_device(stack, distance_to(goals, stack), schedule, keep_best=keep_best)
    for goal, result, weights in zip(GOALS, results, stack.network.weights, strict=True):
        alone = learner_of(3)
        expected = minimize(alone, distance_to(goal, alone), schedule, keep_best=keep_best)
        assert result.iterations == expected.iterations
        assert result.stop_reason == expected.stop_reason
        torch.testing.assert_close(weights.cpu(), alone.network.weights)
    assert stack.last_loss == results[0].loss_m


def test_part_of_the_loss_decides_when_to_stop():
    learners = [learner_of(3) for _ in range(2)]

    def partly(learner):
        loss = distance_to(GOALS[0], learner)
        return lambda: PartlyJudgedLoss(loss(), loss().detach() * 0.01)

    schedule = Schedule(400, 0.1, patience=4, min_delta_m=0.01)
    expected = minimize(learners[0], partly(learners[0]), schedule, keep_best=True)
    assert minimize_on_device(learners[1], partly(learners[1]), schedule, keep_best=True) == [
        expected
    ]
    assert expected.stop_reason is StopReason.CONVERGED


@pytest.mark.parametrize("patience", [0, 50])
def test_loss_that_is_not_finite(patience, device):
    def broken_after(number):
        learner = learner_of(3, device=device)
        count = torch.zeros((), device=device)

        def loss_of():
            count.add_(1)
            loss = distance_to(GOALS[0].to(device), learner)()
            return torch.where(count > number, math.nan, 1.0) * loss

        return learner, loss_of

    schedule = Schedule(25, 0.1, patience=patience)
    learner, loss_of = broken_after(12)
    (result,) = minimize_on_device(learner, loss_of, schedule, keep_best=True)
    assert (result.iterations, result.stop_reason) == (12, StopReason.NOT_FINITE)
    assert math.isfinite(result.loss_m)
    assert learner.network.weights.isfinite().all()
    for number in (0, 12):
        with pytest.raises(OptimizationError, match="the loss became nan"):
            minimize_on_device(*broken_after(number), schedule, keep_best=False)


def test_can_be_cancelled():
    asked = iter([False, False, True])
    schedule = Schedule(25, 0.1, cancelled=lambda: next(asked))
    learner = learner_of(3)
    with pytest.raises(CancelledError):
        minimize_on_device(learner, distance_to(GOALS[0], learner), schedule, keep_best=True)


def test_deadline():
    learner = learner_of(3)
    schedule = Schedule(25, 0.1, deadline=0.0)
    loss_of = distance_to(GOALS[0], learner)
    (result,) = minimize_on_device(learner, loss_of, schedule, keep_best=False)
    assert (result.iterations, result.stop_reason) == (1, StopReason.TIME_BUDGET)


def test_draws_the_batches_that_the_host_draws(device):
    def batches_of(size):
        rows = torch.arange(100.0, device=device)[:, None]
        return Batches(rows, size, generator)

    drawn = []
    for minimized in (minimize, minimize_on_device):
        generator = torch.Generator().manual_seed(3)
        learner = learner_of(1, device=device)
        sources = [batches_of(size) for size in (7, 5, 0)]
        if minimized is minimize:
            # The host draws when it is asked; on CUDA this loop is the other one.
            values = [torch.stack([s.draw().sum() for s in sources]).cpu() for _ in range(25)]
            drawn.append(torch.stack(values))
            continue
        seen = torch.zeros(25, 3, device=device)
        count = torch.zeros(1, dtype=torch.int64, device=device)

        def loss_of(sources=sources, seen=seen, count=count, learner=learner):
            seen.index_copy_(0, count, torch.stack([s.draw().sum() for s in sources])[None])
            count.add_(1)
            return learner.network.weights.sum()

        schedule = Schedule(25, 0.1)
        minimize_on_device(learner, loss_of, schedule, keep_best=False, sources=sources)
        drawn.append(seen.cpu())
    assert torch.equal(*drawn)
