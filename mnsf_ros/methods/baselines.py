# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""NSFP and FNSF, the baselines of the paper, and their variants."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import nn

from mnsf_ros.core.target_distance import NearestNeighborDistance
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.methods.fields import fresh_field, penalty, schedule_for

# The time of the current sweep, in intervals; the previous one is at -1.
_NOW, _BEFORE = 0.0, -1.0


def fnsf(bench: Workbench, *, is_linear: bool = False) -> torch.Tensor:
    """FNSF (Li 2023), the forward field of the paper's method; (N, 3) metres.

    Minimizes mean D(p + g(p), S3). A linear field is one on a Kronecker product of encodings.
    """
    field = fresh_field(bench, is_linear=is_linear)

    def loss_of() -> torch.Tensor:
        points = bench.points
        return bench.next.distance.mean(points + field(points)) + penalty(field, bench)

    schedule = schedule_for(field, bench.field_schedule(), bench)
    bench.fit("forward", field, loss_of, schedule)
    return bench.flow("forward", field)


def fnsf_joint(bench: Workbench, *, has_time: bool = False) -> torch.Tensor:
    """One field for t-1 -> t and t -> t+1; (N, 3) metres.

    Minimizes mean D(p + g(p), S3) over p in S2 + mean D(q + g(q), S2) over q in S1. With the time
    as a fourth input it is g(p, 0) and g(q, -1).
    """
    field = fresh_field(bench, num_inputs=4 if has_time else 3)
    (previous,) = bench.before
    points, earlier = bench.points, bench.sampled_points(previous)

    def at(time: float, positions: torch.Tensor) -> torch.Tensor:
        times = torch.full_like(positions[:, :1], time)
        return torch.cat([positions, times], dim=1) if has_time else positions

    def loss_of() -> torch.Tensor:
        to_next = bench.next.distance.mean(points + field(at(_NOW, points)))
        return to_next + bench.current.distance.mean(earlier + field(at(_BEFORE, earlier)))

    bench.fit("forward", field, loss_of, bench.field_schedule())
    return bench.flow("forward", field, at(_NOW, bench.current.positions))


def nsfp(bench: Workbench, *, is_linear: bool = False) -> torch.Tensor:
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
        bench.field_schedule(),
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
