# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a carried field still fits."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.forward_backward_fields import still_fits
from mnsf_ros.core.learner import Learner
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.settings import Settings


def whole(points):
    return Batches(points, 0, torch.Generator())


def distance_to(points, **changes):
    names = {f"distance.{name}": value for name, value in changes.items()}
    return TargetDistance.to_points(points, Settings().changed(names).distance)


class ConstantFlow(nn.Module):
    """A field that moves everything alike."""

    def __init__(self, flow):
        super().__init__()
        self.flow = nn.Parameter(flow)

    def forward(self, positions):
        return self.flow.expand(len(positions), 3)


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
