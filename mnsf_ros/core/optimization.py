# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The one Adam loop of the project: make a network's loss small, keep the best weights."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Sequence
from typing import Any

import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.device_optimization import minimize_on_device
from mnsf_ros.core.flow_estimate import OptimizationResult, StopReason
from mnsf_ros.core.learner import Learner, LossOf, PartlyJudgedLoss, checked_loss
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.errors import CancelledError


class EarlyStopping:
    """Counts the iterations since the loss last fell by a minimum."""

    def __init__(self, patience: int, min_delta_m: float) -> None:
        """Sets the rule.

        Args:
            patience: Iterations without improvement that are borne; 0 turns the rule off.
            min_delta_m: A smaller fall of the loss is no improvement.
        """
        self._patience = patience
        self._min_delta_m = min_delta_m
        self._best = math.inf
        self._num_without_improvement = 0

    @property
    def is_on(self) -> bool:
        """False if this rule never stops anything; the loss then need not be known."""
        return self._patience > 0

    def should_stop(self, loss: float) -> bool:
        """Takes the loss of one more iteration and says whether to stop."""
        if loss < self._best - self._min_delta_m:
            self._best = loss
            self._num_without_improvement = 0
        else:
            self._num_without_improvement += 1
        return self.is_on and self._num_without_improvement >= self._patience


def minimize(
    learner: Learner,
    loss_of: LossOf,
    schedule: Schedule,
    *,
    keep_best: bool,
    sources: Sequence[Batches] = (),
) -> OptimizationResult:
    """Optimizes the learner's network in place, on CUDA without waiting for each step.

    Args:
        learner: Network and optimizer. Gets the final loss as `last_loss`.
        loss_of: Computes the loss of the network as it is now, a scalar, as a rule in metres.
        schedule: Number and size of the steps, and when to stop.
        keep_best: Whether to return to the weights of the lowest loss. Meaningful only if
            `loss_of` means the same thing at each call, not for random batches.
        sources: The batches that `loss_of` draws from, in the order of drawing.

    Raises:
        OptimizationError: If the loss is not finite and there are no better weights to return to.
        CancelledError: If the schedule's `cancelled` says so.
    """
    if learner.optimizer is None:
        loss, _ = _parts(loss_of())
        return OptimizationResult(checked_loss(loss.item()), 0, StopReason.CONVERGED)
    if next(learner.network.parameters()).is_cuda:
        (result,) = minimize_on_device(
            learner, loss_of, schedule, keep_best=keep_best, sources=sources
        )
        return result
    best = _BestWeights(learner.network)
    stopping = EarlyStopping(schedule.patience, schedule.min_delta_m)
    loss = torch.tensor(math.nan)
    iterations, reason = 0, StopReason.ITERATION_LIMIT
    while iterations < schedule.max_iterations:
        if schedule.cancelled():
            raise CancelledError("the estimate was cancelled")
        if iterations and time.monotonic() > schedule.deadline:
            reason = StopReason.TIME_BUDGET
            break
        loss, judged = _parts(loss_of())
        # Reading the loss makes a GPU wait, so it is read only where somebody looks at it.
        value = loss.item() if keep_best or stopping.is_on else 0.0
        if not math.isfinite(value):
            reason = StopReason.NOT_FINITE
            break
        if keep_best:
            best.offer(value)
        _step(learner.optimizer, loss, schedule.learning_rate_at(iterations))
        iterations += 1
        if stopping.should_stop(value if judged is loss else judged.item()):
            reason = StopReason.CONVERGED
            break
    learner.last_loss = _final_loss(loss, best)
    return OptimizationResult(learner.last_loss, iterations, reason)


def _parts(loss: torch.Tensor | PartlyJudgedLoss) -> tuple[torch.Tensor, torch.Tensor]:
    """What to make small, and what to judge it by."""
    return (loss.total, loss.judged) if isinstance(loss, PartlyJudgedLoss) else (loss, loss)


def _step(optimizer: torch.optim.Adam, loss: torch.Tensor, learning_rate: float) -> None:
    for group in optimizer.param_groups:
        group["lr"] = learning_rate
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def _final_loss(loss: torch.Tensor, best: _BestWeights) -> float:
    if best.loss < math.inf:
        best.restore()
        return best.loss
    return checked_loss(loss.item())


class _BestWeights:
    """The weights that had the lowest loss so far."""

    def __init__(self, network: nn.Module) -> None:
        self._network = network
        self._weights: dict[str, Any] = {}
        self.loss = math.inf

    def offer(self, loss: float) -> None:
        """Keeps the network's weights if their loss is the lowest."""
        if loss < self.loss:
            self.loss = loss
            self._weights = copy.deepcopy(self._network.state_dict())

    def restore(self) -> None:
        """Puts the best weights back into the network."""
        self._network.load_state_dict(self._weights)
