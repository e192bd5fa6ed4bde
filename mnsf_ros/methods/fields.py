# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The two kinds of flow field: the perceptron of the paper, and a linear one."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import nn
from torch.nn import functional

from mnsf_ros.core.compute_device import layer_precision
from mnsf_ros.core.networks import Perceptron
from mnsf_ros.core.optimization import Schedule
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.errors import SweepError
from mnsf_ros.settings import LinearSettings

_MAX_NODES = 4_000_000
# Under the root of the total variation, square metres: a constant flow has a gradient, too.
_VARIATION_FLOOR = 1e-5


def fresh_field(bench: Workbench, *, is_linear: bool = False, num_inputs: int = 3) -> nn.Module:
    """A fresh field of the paper, or a linear one on a grid around the current and the next sweep.

    Raises:
        SweepError: If the grid would be too large.
    """
    if not is_linear:
        precision = layer_precision(bench.settings.compute)
        field = Perceptron(bench.settings.field, bench.generator, num_inputs, precision)
        return field.to(bench.device)
    points = torch.cat([bench.current.points, bench.next.points]).cpu()
    return KroneckerField(points, bench.settings.linear, bench.generator).to(bench.device)


def penalty(field: nn.Module, bench: Workbench) -> torch.Tensor | float:
    """Smoothness term of the loss: total variation of a linear field, 0 of a perceptron."""
    if isinstance(field, KroneckerField):
        return bench.settings.linear.variation_weight * field.total_variation()
    return 0.0


def schedule_for(field: nn.Module, schedule: Schedule, bench: Workbench) -> Schedule:
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
        unit = 2 * (positions - self._low) / self._extent - 1  # [M, 3], -1..1 inside
        blended = functional.grid_sample(
            self._node_flow()[None],
            unit.flip(1)[None, None, None],  # grid_sample wants the last axis first
            mode="bilinear",
            padding_mode="border",
            align_corners=True,
        )
        return blended.view(3, -1).T

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
        variation: torch.Tensor = squares.sqrt().sum(dim=0).mean()
        return variation

    def _node_flow(self) -> torch.Tensor:
        codes = (self._code_0, self._code_1, self._code_2)
        flow: torch.Tensor = torch.einsum("cijk,xi,yj,zk->cxyz", self._weights, *codes)
        return flow  # [3, nx, ny, nz]


def _gaussian_code(number: int, settings: LinearSettings) -> torch.Tensor:
    """The code of each of the nodes along an axis, one a row; the longest has length 1."""
    places = torch.arange(number) * settings.node_spacing_m
    code = torch.exp(-0.5 * ((places[:, None] - places) / settings.sigma_m) ** 2)
    scaled: torch.Tensor = code / code.norm(dim=1).max()
    return scaled
