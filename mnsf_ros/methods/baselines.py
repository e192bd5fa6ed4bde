# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""NSFP and FNSF, the baselines of the paper, and their variants."""

import math
from dataclasses import replace
from typing import Final

import torch
from torch import nn

from mnsf_ros.errors import SweepError
from mnsf_ros.networks.distance_transform import between_nodes
from mnsf_ros.networks.optimization import Schedule
from mnsf_ros.networks.target_distance import NearestNeighborDistance
from mnsf_ros.networks.workbench import Workbench
from mnsf_ros.settings import LinearSettings

# The time of the current sweep, in intervals; the previous one is at -1.
_NOW, _BEFORE = 0.0, -1.0

_MAX_NODES: Final = 4_000_000
# Under the root of the total variation, square metres: a constant flow has a gradient, too.
_VARIATION_FLOOR: Final = 1e-5


def fnsf(bench: Workbench, *, is_linear: bool = False) -> torch.Tensor:
    """FNSF (Li 2023), the forward field of the paper's method; (N, 3) metres.

    Minimizes mean D(p + g(p), S3). A linear field is one on a Kronecker product of encodings.
    """
    field = _fresh_field(bench, is_linear=is_linear)

    def loss_of() -> torch.Tensor:
        points = bench.points
        return bench.next.distance.mean(points + field(points)) + _penalty(field, bench)

    schedule = _schedule_for(field, bench.field_schedule(), bench)
    bench.fit("forward", field, loss_of, schedule)
    return bench.flow("forward", field)


def fnsf_joint(bench: Workbench, *, has_time: bool = False) -> torch.Tensor:
    """One field for t-1 -> t and t -> t+1; (N, 3) metres.

    Minimizes mean D(p + g(p), S3) over p in S2 + mean D(q + g(q), S2) over q in S1. With the time
    as a fourth input it is g(p, 0) and g(q, -1).
    """
    field = bench.fresh_field(num_inputs=4 if has_time else 3)
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
    there, back = (_fresh_field(bench, is_linear=is_linear) for _ in range(2))
    settings = bench.settings.nsfp
    to_next = ChamferDistance(bench.sampled_points(bench.next), settings.truncation_m)
    to_current = ChamferDistance(points, settings.truncation_m)

    def loss_of() -> torch.Tensor:
        moved = points + there(points)
        returned = moved + back(moved)
        smoothness = _penalty(there, bench) + _penalty(back, bench)
        return to_next(moved) + to_current(returned) + smoothness

    both = nn.ModuleList([there, back])
    schedule = replace(
        bench.field_schedule(),
        learning_rate=settings.learning_rate,
        patience=settings.patience,
        min_delta_m=settings.min_delta_m2,
        weight_decay=settings.weight_decay,
    )
    schedule = _schedule_for(there, schedule, bench)
    bench.fit("forward", both, loss_of, schedule)
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


def _fresh_field(bench: Workbench, *, is_linear: bool) -> nn.Module:
    """A fresh field of the paper, or a linear one on a grid around the current and next sweep."""
    if not is_linear:
        return bench.fresh_field()
    points = torch.cat([bench.current.points, bench.next.points]).cpu()
    return KroneckerField(points, bench.settings.linear, bench.generator).to(bench.device)


def _penalty(field: nn.Module, bench: Workbench) -> torch.Tensor | float:
    """Smoothness term of the loss: total variation of a linear field, 0 of a perceptron."""
    if isinstance(field, KroneckerField):
        return bench.settings.linear.variation_weight * field.total_variation()
    return 0.0


def _schedule_for(field: nn.Module, schedule: Schedule, bench: Workbench) -> Schedule:
    """The schedule with the step size that suits the kind of field."""
    if isinstance(field, KroneckerField):
        return replace(schedule, learning_rate=bench.settings.linear.learning_rate)
    return schedule


class KroneckerField(nn.Module):
    """Flow at any position: (M, 3) metres in, (M, 3) metres out.

    At the nodes of a coarse grid the flow is the weights times the Kronecker product of three
    Gaussian codes, one along each axis; between the nodes it is blended from the eight around.
    (The authors blend with a Gaussian much wider than a cell, which is all but linear.)
    """

    _low: torch.Tensor
    _extent: torch.Tensor
    _code_0: torch.Tensor
    _code_1: torch.Tensor
    _code_2: torch.Tensor

    def __init__(
        self, points: torch.Tensor, settings: LinearSettings, generator: torch.Generator
    ) -> None:
        """Lays the grid around (N, 3) points, metres, with a node to spare on each side.

        Raises:
            SweepError: If the grid would be too large.
        """
        super().__init__()
        spacing = settings.node_spacing_m
        low = torch.floor(points.min(dim=0).values / spacing) - 1
        high = torch.ceil(points.max(dim=0).values / spacing) + 1
        shape = [int(number) + 1 for number in (high - low).tolist()]
        if math.prod(shape) > _MAX_NODES:
            raise SweepError(
                f"the grid of the linear field would have {' x '.join(map(str, shape))} nodes, "
                f"expected at most {_MAX_NODES}; crop the sweeps or widen linear.node_spacing_m"
            )
        self.register_buffer("_low", low * spacing)
        self.register_buffer("_extent", (high - low) * spacing)
        for axis, number in enumerate(shape):
            self.register_buffer(f"_code_{axis}", _gaussian_code(number, settings))
        start = torch.rand(3, *shape, generator=generator)
        self._weights = nn.Parameter((2 * start - 1) / math.sqrt(3))

    def forward(self, positions: torch.Tensor) -> torch.Tensor:
        """Flow at the positions; outside the grid that at its border."""
        unit = 2 * (positions - self._low) / self._extent - 1
        return between_nodes(self._node_flow(), unit).T

    def total_variation(self) -> torch.Tensor:
        """Mean change of the flow between neighbouring nodes, metres."""
        flow = self._node_flow()
        corner = flow[:, :-1, :-1, :-1]
        squares = (
            _VARIATION_FLOOR
            + (flow[:, 1:, :-1, :-1] - corner) ** 2
            + (flow[:, :-1, 1:, :-1] - corner) ** 2
            + (flow[:, :-1, :-1, 1:] - corner) ** 2
        )
        return squares.sqrt().sum(dim=0).mean()

    def _node_flow(self) -> torch.Tensor:
        codes = (self._code_0, self._code_1, self._code_2)
        return torch.einsum("cijk,xi,yj,zk->cxyz", self._weights, *codes)  # [3, nx, ny, nz]


def _gaussian_code(number: int, settings: LinearSettings) -> torch.Tensor:
    """The code of each of the nodes along an axis, one a row; the longest has length 1."""
    places = torch.arange(number) * settings.node_spacing_m
    code = torch.exp(-0.5 * ((places[:, None] - places) / settings.sigma_m) ** 2)
    return code / code.norm(dim=1).max()
