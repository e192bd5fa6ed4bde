# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fitting g_f toward the next sweep and g_b toward the previous one (section 3, steps 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.flow_estimate import OptimizationResult
from mnsf_ros.core.learner import Learner, PartlyJudgedLoss
from mnsf_ros.core.optimization import minimize, minimize_stack
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance

# Below this the loss is noise of the sensor, and its ratio says nothing.
_SMALLEST_LOSS_M = 0.02


def fit_field(
    field: Learner,
    batches: Batches,
    target: TargetDistance,
    schedule: Schedule,
    *,
    keep_best: bool = True,
) -> OptimizationResult:
    """Makes a field move the current points onto a target sweep: minimizes mean D(p + g(p), S).

    The batches are rows (M, 3): points of the current sweep, metres. With `keep_best` the field
    ends with the weights of the lowest loss, where losses can be compared, else of the last step.

    Raises:
        OptimizationError: If the loss is not finite.
        CancelledError: If the schedule says so.
    """

    def loss_of() -> torch.Tensor:
        points = batches.draw()
        return target.mean(points + field.network(points))

    keep_best = keep_best and batches.are_whole
    return minimize(field, loss_of, schedule, keep_best=keep_best, sources=[batches])


def fit_jointly(
    fields: Sequence[Learner],
    batches: Batches,
    targets: Sequence[TargetDistance],
    schedule: Schedule,
    *,
    keep_best: bool = True,
) -> OptimizationResult:
    """Fits all fields in the same steps, as the authors' code does, not the paper.

    The fields share one optimizer, and the loss is the sum of theirs. Whether it still falls is
    judged by that of the first field alone, so the others may stop half-way.

    Raises:
        OptimizationError: If the loss is not finite.
        CancelledError: If the schedule says so.
    """

    def loss_of() -> PartlyJudgedLoss:
        losses = _losses(fields, batches, targets)
        return PartlyJudgedLoss(torch.stack(losses).sum(), losses[0])

    networks = nn.ModuleList(field.network for field in fields)
    together = Learner(networks, fields[0].optimizer)
    keep_best = keep_best and batches.are_whole
    result = minimize(together, loss_of, schedule, keep_best=keep_best, sources=[batches])
    with torch.no_grad():
        for field, loss in zip(fields, _losses(fields, batches, targets), strict=True):
            field.last_loss = loss.item()
    return result


def fit_stacked(
    stack: Learner,
    fields: Sequence[Learner],
    batches: Batches,
    targets: Sequence[TargetDistance],
    schedule: Schedule,
    *,
    keep_best: bool = True,
) -> list[OptimizationResult]:
    """Fits each field to its own target as `fit_field` does, all of them in the same steps.

    The fields are those of the stack. Each draws the same points, and is judged by itself.

    Raises:
        OptimizationError: If a loss is not finite.
        CancelledError: If the schedule says so.
    """

    def losses_of() -> torch.Tensor:
        points = batches.draw()
        flows = stack.network(points)  # [K, M, 3]
        pairs = zip(targets, flows, strict=True)
        return torch.stack([target.mean(points + flow) for target, flow in pairs])

    keep_best = keep_best and batches.are_whole
    results = minimize_stack(stack, losses_of, schedule, keep_best=keep_best, sources=[batches])
    for field, result in zip(fields, results, strict=True):
        field.last_loss = result.loss_m
    return results


def _losses(
    fields: Sequence[Learner], batches: Batches, targets: Sequence[TargetDistance]
) -> list[torch.Tensor]:
    points = batches.draw()
    return [
        target.mean(points + field.network(points))
        for field, target in zip(fields, targets, strict=True)
    ]


@torch.no_grad()
def still_fits(
    field: Learner, batches: Batches, target: TargetDistance, max_loss_ratio: float
) -> bool:
    """Whether a field that was fitted to an earlier pair of sweeps fits this pair, too.

    Its loss may be at most `max_loss_ratio` times that at the end of its fit.
    """
    if field.last_loss is None:
        return False
    points = batches.draw()
    loss = target.mean(points + field.network(points)).item()
    return loss <= max_loss_ratio * max(field.last_loss, _SMALLEST_LOSS_M)
