# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The network of a field: what its depth counts, and where its first weights come from."""

from __future__ import annotations

import math

import pytest
import torch

from mnsf_ros.core.flow_field import FlowField, Perceptron, StackedFields
from mnsf_ros.presets import preset
from mnsf_ros.settings import FieldSettings, Settings

SMALL = FieldSettings(num_hidden_layers=2, hidden_width=8)


def seeded(seed):
    return torch.Generator().manual_seed(seed)


def weights(network):
    return torch.cat([weight.detach().flatten() for weight in network.parameters()])


@pytest.mark.parametrize("num_hidden_layers", [1, 3, 8])
def test_depth_counts_hidden_layers(num_hidden_layers):
    layers = Perceptron(FieldSettings(num_hidden_layers, 16), seeded(0)).linear_layers
    inputs = [3] + [16] * num_hidden_layers
    assert [layer.in_features for layer in layers] == inputs
    assert [layer.out_features for layer in layers] == [*inputs[1:], 3]


def test_hidden_layers_have_a_relu_and_the_output_layer_has_none(generator):
    network = Perceptron(FieldSettings(2, 16), generator)
    points = torch.randn(50, 3, generator=generator)
    first, second, last = network.linear_layers
    expected = last(second(first(points).relu()).relu())
    torch.testing.assert_close(network(points), expected)
    assert (expected < 0).any()


def test_eight_layers_of_the_paper():
    # 3*128 + 128 in, seven times 128*128 + 128 between, 128*3 + 3 out.
    field = FlowField(preset("paper").field, seeded(0))
    assert weights(field).numel() == 512 + 7 * 16_512 + 387 == 116_483


def test_same_seed_same_weights():
    settings = Settings().field
    first, again, other = (weights(FlowField(settings, seeded(seed))) for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_weights_do_not_depend_on_global_randomness():
    torch.manual_seed(1)
    first = weights(Perceptron(FieldSettings(2, 8), seeded(0)))
    torch.manual_seed(2)
    assert torch.equal(first, weights(Perceptron(FieldSettings(2, 8), seeded(0))))


def test_layers_of_one_network_differ(generator):
    network = Perceptron(FieldSettings(4, 16), generator)
    assert not torch.equal(network.linear_layers[1].weight, network.linear_layers[2].weight)


def test_weights_start_after_xavier_and_biases_at_zero(generator):
    for layer in Perceptron(FieldSettings(2, 64), generator).linear_layers:
        bound = math.sqrt(6 / (layer.in_features + layer.out_features))
        assert 0.8 * bound < layer.weight.abs().max() <= bound
        assert not layer.bias.any()


def test_flow_has_one_row_for_each_position(device, generator):
    field = FlowField(Settings().field, generator).to(device)
    positions = torch.rand(50, 3, device=device)
    flow = field(positions)
    assert flow.shape == (50, 3)
    torch.testing.assert_close(flow[7:8], field(positions[7:8]))
    assert field(positions[:0]).shape == (0, 3)


def test_stack_gives_the_flow_of_each_field(device, generator):
    fields = [FlowField(SMALL, generator).to(device) for _ in range(3)]
    points = torch.rand(20, 3, device=device)
    before = torch.stack([field(points) for field in fields]).detach()
    stack = StackedFields(fields)
    torch.testing.assert_close(stack(points).detach(), before)
    torch.testing.assert_close(torch.stack([field(points) for field in fields]), before)


def test_stack_shares_its_weights_with_the_fields(device, generator):
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
    assert any(layer.weight.any() for layer in field.linear_layers)


def precise_pair(num_hidden_layers):
    """A network of float32, and the same one of bfloat16."""
    return [
        Perceptron(FieldSettings(num_hidden_layers, 64), seeded(0), precision=precision)
        for precision in (torch.float32, torch.bfloat16)
    ]


def test_bfloat16_is_near_float32_and_not_the_same():
    points = torch.randn(500, 3, generator=seeded(1)) * 20
    exact, near = precise_pair(4)
    flow = exact(points)
    assert near(points).dtype == torch.float32
    error = (near(points) - flow).norm(dim=1).mean() / flow.norm(dim=1).mean()
    assert 1e-5 < error < 0.02


def test_positions_and_flow_are_float32_in_any_precision():
    # The first and the last layer are all there is: a bfloat16 has 3 digits.
    points = torch.tensor([[80.001, -3.0, 0.5], [80.002, -3.0, 0.5]])
    exact, near = precise_pair(1)
    assert torch.equal(near(points), exact(points))


def test_gradients_and_weights_stay_float32(generator):
    exact, near = precise_pair(4)
    points = torch.randn(500, 3, generator=generator)
    for network in (exact, near):
        network(points).square().sum().backward()
    for of_exact, of_near in zip(exact.parameters(), near.parameters(), strict=True):
        assert of_near.dtype == of_near.grad.dtype == torch.float32
        error = (of_near.grad - of_exact.grad).norm() / of_exact.grad.norm()
        assert 0 <= error < 0.05


def test_stack_has_the_precision_of_its_fields(generator):
    fields = [FlowField(SMALL, generator, precision=torch.bfloat16) for _ in range(2)]
    points = torch.rand(20, 3)
    before = torch.stack([field(points) for field in fields]).detach()
    exact = StackedFields([FlowField(SMALL, generator) for _ in range(2)])
    stack = StackedFields(fields)
    # Sums may be rounded in another order: a few units of the last of 8 bits.
    torch.testing.assert_close(stack(points).detach(), before, atol=0.02, rtol=0.02)
    assert stack(points).dtype == exact(points).dtype == torch.float32
