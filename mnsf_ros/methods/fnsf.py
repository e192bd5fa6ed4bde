# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""FNSF: one field, fitted with the distance D to the target sweep, and its variants."""

from __future__ import annotations

import torch

from mnsf_ros.core.schedule import Schedules
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.methods.fields import fresh_field, penalty, schedule_for

# The time of the current sweep, in intervals; the previous one is at -1.
_NOW, _BEFORE = 0.0, -1.0


def fnsf(bench: Workbench, schedules: Schedules, *, is_linear: bool = False) -> torch.Tensor:
    """FNSF (Li 2023), the forward field of the paper's method; (N, 3) metres.

    Minimizes mean D(p + g(p), S3). A linear field is one on a Kronecker product of encodings.
    """
    field = fresh_field(bench, is_linear=is_linear)

    def loss_of() -> torch.Tensor:
        points = bench.points
        return bench.next.distance.mean(points + field(points)) + penalty(field, bench)

    schedule = schedule_for(field, schedules.field(), bench)
    bench.fit("forward", field, loss_of, schedule)
    return bench.flow("forward", field)


def fnsf_joint(bench: Workbench, schedules: Schedules, *, has_time: bool = False) -> torch.Tensor:
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

    bench.fit("forward", field, loss_of, schedules.field())
    return bench.flow("forward", field, at(_NOW, bench.current.positions))
