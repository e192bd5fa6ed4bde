# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fitting one field to one pair of sweeps."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core.batches import Batches, evaluate
from mnsf_ros.core.flow_field import FlowField
from mnsf_ros.core.forward_backward_fields import fit_field, still_fits
from mnsf_ros.core.optimization import Learner
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.errors import CancelledError, OptimizationError
from mnsf_ros.settings import Settings

SHIFT = (0.3, -0.2, 0.1)


@pytest.fixture
def points(generator, device):
    return (6 * torch.rand(300, 3, generator=generator) - 3).to(device)


def whole(points):
    return Batches(points, 0, torch.Generator())


def distance_to(points, **changes):
    names = {f"distance.{name}": value for name, value in changes.items()}
    return TargetDistance.to_points(points, Settings().changed(names).distance)


def fresh_field(device):
    settings = Settings().changed({"field.num_hidden_layers": 2, "field.hidden_width": 32}).field
    return Learner.fresh(FlowField(settings, torch.Generator().manual_seed(1)).to(device))


@pytest.mark.parametrize("kind", ["grid", "tree"])
@pytest.mark.parametrize("batch_points", [0, 100])
def test_translated_cloud_has_constant_flow(points, generator, kind, batch_points):
    shift = points.new_tensor(SHIFT)
    field = fresh_field(points.device)
    target = distance_to(points + shift, kind=kind)
    batches = Batches(points, batch_points, generator)
    result = fit_field(field, batches, target, Schedule(300, 0.01, decay=True))
    error = (evaluate(field.network, points) - shift).norm(dim=1)
    assert error.mean() < 0.05
    assert result.loss_m < 0.06
    assert field.last_loss == result.loss_m


def test_field_toward_the_previous_sweep_has_the_opposite_flow(points):
    shift = points.new_tensor(SHIFT)
    field = fresh_field(points.device)
    fit_field(field, whole(points), distance_to(points - shift), Schedule(300, 0.01, decay=True))
    torch.testing.assert_close(
        evaluate(field.network, points).mean(dim=0), -shift, atol=0.02, rtol=0
    )


def test_loss_is_the_mean_distance_of_the_moved_points(points):
    field = fresh_field(points.device)
    target = distance_to(points)
    moved = points + evaluate(field.network, points)
    result = fit_field(field, whole(points), target, Schedule(1, 1e-6))
    assert result.loss_m == pytest.approx(target.mean(moved).item(), rel=1e-5)


def test_cancelled(points):
    schedule = Schedule(10, 0.01, cancelled=lambda: True)
    with pytest.raises(CancelledError):
        fit_field(fresh_field(points.device), whole(points), distance_to(points), schedule)


class ConstantFlow(nn.Module):
    """A field that moves everything alike."""

    def __init__(self, flow):
        super().__init__()
        self.flow = nn.Parameter(flow)

    def forward(self, positions):
        return self.flow.expand(len(positions), 3)


def broken_field(device):
    return Learner.fresh(ConstantFlow(torch.full((3,), math.nan, device=device)))


@pytest.mark.parametrize("kind", ["grid", "tree"])
@pytest.mark.parametrize("batch_points", [0, 100])
def test_flow_that_is_not_finite(points, generator, kind, batch_points):
    batches = Batches(points, batch_points, generator)
    with pytest.raises(OptimizationError, match=r"^the loss became nan, "):
        fit_field(
            broken_field(points.device), batches, distance_to(points, kind=kind), Schedule(5, 0.01)
        )


def carried_field(points, *, off_m, last_loss):
    """A field that was fitted to `last_loss` once and now is so far off."""
    field = Learner.fresh(ConstantFlow(points.new_tensor([off_m, 0.0, 0.0])))
    field.last_loss = last_loss
    return field


@pytest.mark.parametrize(
    ("off_m", "last_loss", "fits"),
    [
        (0.3, 0.2, True),
        (0.39, 0.2, True),
        (0.41, 0.2, False),
        (0.3, 0.1, False),
        # Below 2 cm the loss is noise: 2 mm may become 39 mm, but not 41 mm.
        (0.039, 0.002, True),
        (0.041, 0.002, False),
        (0.3, None, False),  # never fitted
        (math.nan, 0.2, False),
    ],
)
def test_carried_field_fits_unless_its_loss_grew_more_than_twofold(device, off_m, last_loss, fits):
    # 1 m apart, so that a small flow is the distance to the nearest point.
    points = torch.cartesian_prod(*[torch.arange(4.0)] * 3).to(device)
    field = carried_field(points, off_m=off_m, last_loss=last_loss)
    assert still_fits(field, whole(points), distance_to(points), 2.0) is fits
