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
from mnsf_ros.core.learner import Learner
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.errors import OptimizationError
from mnsf_ros.settings import FieldSettings, Settings

SHIFT = (0.3, -0.2, 0.1)


@pytest.fixture
def points(generator, device):
    return (6 * torch.rand(300, 3, generator=generator) - 3).to(device)


def whole(points):
    return Batches(points, 0, torch.Generator())


def distance_to(points, **changes):
    names = {f"distance.{name}": value for name, value in changes.items()}
    return TargetDistance.to_points(points, Settings().changed(names).distance)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("kind", ["grid", "tree"])
@pytest.mark.parametrize("batch_points", [0, 100])
def test_translated_cloud_has_constant_flow(points, generator, kind, batch_points, sign):
    shift = sign * points.new_tensor(SHIFT)
    network = FlowField(FieldSettings(2, 32), torch.Generator().manual_seed(1))
    field = Learner.fresh(network.to(points.device))
    target = distance_to(points + shift, kind=kind)
    batches = Batches(points, batch_points, generator)
    result = fit_field(field, batches, target, Schedule(300, 0.01, decay=True))
    flow = evaluate(field.network, points)
    assert (flow - shift).norm(dim=1).mean() < 0.05
    assert field.last_loss == result.loss_m < 0.06
    if not batch_points:
        # The loss is the mean distance of the moved points.
        assert result.loss_m == pytest.approx(target.mean(points + flow).item(), rel=1e-4)


class ConstantFlow(nn.Module):
    """A field that moves everything alike."""

    def __init__(self, flow):
        super().__init__()
        self.flow = nn.Parameter(flow)

    def forward(self, positions):
        return self.flow.expand(len(positions), 3)


@pytest.mark.parametrize("kind", ["grid", "tree"])
@pytest.mark.parametrize("batch_points", [0, 100])
def test_flow_that_is_not_finite(points, generator, kind, batch_points):
    broken = Learner.fresh(ConstantFlow(points.new_full((3,), math.nan)))
    batches = Batches(points, batch_points, generator)
    with pytest.raises(OptimizationError, match=r"^the loss became nan, "):
        fit_field(broken, batches, distance_to(points, kind=kind), Schedule(5, 0.01))


@pytest.mark.parametrize(
    ("off_m", "last_loss", "fits"),
    [
        (0.39, 0.2, True),
        (0.41, 0.2, False),
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
    field = Learner.fresh(ConstantFlow(points.new_tensor([off_m, 0.0, 0.0])))
    field.last_loss = last_loss
    assert still_fits(field, whole(points), distance_to(points), 2.0) is fits
