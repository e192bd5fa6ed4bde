# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""NSFP: a field and its inverse, fitted with the Chamfer distance and a cycle term."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import nn

from mnsf_ros.core.schedule import Schedules
from mnsf_ros.core.target_distance import NearestNeighborDistance
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.methods.fields import fresh_field, penalty, schedule_for


def nsfp(bench: Workbench, schedules: Schedules, *, is_linear: bool = False) -> torch.Tensor:
    """NSFP (Li 2021), by minimizing Chamfer(p + g(p), S3) + Chamfer(p', S2); (N, 3) metres.

    p' = q + h(q) with q = p + g(p) is where the inverse field h takes the moved points back to.
    A linear field is one on a Kronecker product of encodings.
    """
    points = bench.points
    there, back = (fresh_field(bench, is_linear=is_linear) for _ in range(2))
    settings = bench.settings.nsfp
    to_next = ChamferDistance(bench.sampled_points(bench.next), settings.truncation_m)
    to_current = ChamferDistance(points, settings.truncation_m)

    def loss_of() -> torch.Tensor:
        moved = points + there(points)
        returned = moved + back(moved)
        smoothness = penalty(there, bench) + penalty(back, bench)
        return to_next(moved) + to_current(returned) + smoothness

    both = nn.ModuleList([there, back])
    schedule = replace(
        schedules.field(),
        learning_rate=settings.learning_rate,
        patience=settings.patience,
        min_delta_m=settings.min_delta_m2,
    )
    schedule = schedule_for(there, schedule, bench)
    bench.fit("forward", both, loss_of, schedule, weight_decay=settings.weight_decay)
    return bench.flow("forward", there)


class ChamferDistance:
    """Chamfer distance of moved points to a target sweep (section 2 of the paper, after NSFP).

    The mean over the moved points of the squared distance to the nearest target point, plus the
    mean over the target points of that to the nearest moved point. Pairs that are too far apart
    count as zero, but still as one of those whose mean is taken.
    """

    def __init__(self, points: torch.Tensor, truncation_m: float) -> None:
        """Prepares the search among the target points, (N, 3) metres."""
        self._points = points
        self._target = NearestNeighborDistance(points)
        self._largest = truncation_m**2

    def __call__(self, moved: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres to a scalar in square metres, differentiable."""
        # One moved point may be the nearest of many: the gradient pulls it to all of them.
        nearest_moved = moved[NearestNeighborDistance(moved.detach()).nearest_indices(self._points)]
        nearest_target = self._points[self._target.nearest_indices(moved.detach())]
        return self._mean(moved - nearest_target) + self._mean(self._points - nearest_moved)

    def _mean(self, differences: torch.Tensor) -> torch.Tensor:
        squared = differences.square().sum(dim=1)
        return torch.where(squared > self._largest, 0.0, squared).mean()
