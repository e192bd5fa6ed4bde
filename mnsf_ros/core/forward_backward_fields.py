# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fitting g_f toward the next sweep and g_b toward the previous one (section 3, steps 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from mnsf_ros.core.flow_estimate import OptimizationResult
from mnsf_ros.core.optimization import PartlyJudgedLoss, minimize
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance


def fit_field(
    field: nn.Module,
    points: torch.Tensor,
    target: TargetDistance,
    schedule: Schedule,
    *,
    keep_best: bool = True,
) -> OptimizationResult:
    """Makes a field move points (M, 3), metres, onto a target: minimizes mean D(p + g(p), S).

    With `keep_best` the field ends with the weights of the lowest loss, else of the last step.

    Raises:
        OptimizationError: If the loss is not finite.
        CancelledError: If the schedule says so.
    """
    return minimize(
        field, lambda: target.mean(points + field(points)), schedule, keep_best=keep_best
    )


def fit_jointly(
    fields: Sequence[nn.Module],
    points: torch.Tensor,
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
        pairs = zip(fields, targets, strict=True)
        losses = [target.mean(points + field(points)) for field, target in pairs]
        return PartlyJudgedLoss(torch.stack(losses).sum(), losses[0])

    return minimize(nn.ModuleList(fields), loss_of, schedule, keep_best=keep_best)
