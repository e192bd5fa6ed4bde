"""Several fields as one network."""

from __future__ import annotations

import torch

from mnsf_ros.core.flow_field import FlowField
from mnsf_ros.core.stacked_fields import StackedFields
from mnsf_ros.settings import FieldSettings

SMALL = FieldSettings(num_hidden_layers=2, hidden_width=8)


def test_gives_the_flow_of_each_field(device, generator):
    fields = [FlowField(SMALL, generator).to(device) for _ in range(3)]
    points = torch.rand(20, 3, device=device)
    before = torch.stack([field(points) for field in fields]).detach()
    stack = StackedFields(fields)
    torch.testing.assert_close(stack(points).detach(), before)
    torch.testing.assert_close(torch.stack([field(points) for field in fields]), before)


def test_shares_its_weights_with_the_fields(device, generator):
    fields = [FlowField(SMALL, generator).to(device) for _ in range(2)]
    stack = StackedFields(fields)
    points = torch.rand(20, 3, device=device)
    before = fields[1](points).detach()
    optimizer = torch.optim.Adam(stack.parameters(), lr=0.1, fused=True)
    stack(points).square().sum().backward()
    optimizer.step()
    after = torch.stack([field(points) for field in fields])
    assert not torch.allclose(after[1], before)
    torch.testing.assert_close(stack(points), after)


def test_field_that_starts_at_zero(generator):
    settings = FieldSettings(num_hidden_layers=2, hidden_width=8, zero_start=True)
    field = FlowField(settings, generator)
    assert not field(torch.rand(20, 3)).any()
    assert any(layer.weight.any() for layer in field.linear_layers())
