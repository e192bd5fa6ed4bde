"""FNSF: one field, fitted with the distance D to the target sweep, and its variants."""

from __future__ import annotations

import torch

from mnsf_ros.core.flow_field import FlowField
from mnsf_ros.core.optimization import Learner
from mnsf_ros.core.schedule import Schedules
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.methods.fields import (
    FieldMaker,
    linear_field,
    penalty,
    perceptron_field,
    schedule_for,
)

# The time of the current sweep, in intervals; the previous one is at -1.
_NOW, _BEFORE = 0.0, -1.0


def fnsf(bench: Workbench, schedules: Schedules) -> torch.Tensor:
    """FNSF (Li 2023), the forward field of the paper's method; (N, 3) metres."""
    return _flow(bench, schedules, perceptron_field)


def fnsf_linear(bench: Workbench, schedules: Schedules) -> torch.Tensor:
    """FNSF with a linear field on a Kronecker product of encodings; (N, 3) metres."""
    return _flow(bench, schedules, linear_field)


def _flow(bench: Workbench, schedules: Schedules, make_field: FieldMaker) -> torch.Tensor:
    """Minimizes mean D(p + g(p), S3)."""
    field = make_field(bench)

    def loss_of() -> torch.Tensor:
        points = bench.points.draw()
        return bench.next.distance.mean(points + field(points)) + penalty(field, bench)

    schedule = schedule_for(field, schedules.field(), bench)
    bench.fit("forward", Learner.fresh(field), loss_of, schedule)
    return bench.flow("forward", field)


def fnsf_joint(bench: Workbench, schedules: Schedules) -> torch.Tensor:
    """One field for t-1 -> t and t -> t+1; (N, 3) metres.

    Minimizes mean D(p + g(p), S3) over p in S2 + mean D(q + g(q), S2) over q in S1.
    """
    field = perceptron_field(bench)
    (previous,) = bench.before
    earlier_points = bench.batches(bench.sampled_points(previous))

    def loss_of() -> torch.Tensor:
        points, earlier = bench.points.draw(), earlier_points.draw()
        to_next = bench.next.distance.mean(points + field(points))
        return to_next + bench.current.distance.mean(earlier + field(earlier))

    bench.fit("forward", Learner.fresh(field), loss_of, schedules.field())
    return bench.flow("forward", field)


def fnsf_time(bench: Workbench, schedules: Schedules) -> torch.Tensor:
    """The same with the time as a fourth input: g(p, 0) and g(q, -1); (N, 3) metres."""
    field = FlowField(bench.settings.field, bench.generator, num_inputs=4).to(bench.device)
    (previous,) = bench.before
    earlier_points = bench.batches(bench.sampled_points(previous))

    def loss_of() -> torch.Tensor:
        points, earlier = bench.points.draw(), earlier_points.draw()
        to_next = bench.next.distance.mean(points + field(_at(_NOW, points)))
        to_current = bench.current.distance.mean(earlier + field(_at(_BEFORE, earlier)))
        return to_next + to_current

    bench.fit("forward", Learner.fresh(field), loss_of, schedules.field())
    return bench.flow("forward", field, _at(_NOW, bench.current.positions))


def _at(time: float, positions: torch.Tensor) -> torch.Tensor:
    times = torch.full_like(positions[:, :1], time)
    return torch.cat([positions, times], dim=1)  # [M, 4]
