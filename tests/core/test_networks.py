# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The network of a field: depth, first weights and precision."""

import math

import pytest
import torch

from mnsf_ros.core.networks import Perceptron, evaluate
from mnsf_ros.presets import preset
from mnsf_ros.settings import FieldSettings

SMALL = FieldSettings(num_hidden_layers=2, hidden_width=8)


def seeded(seed):
    return torch.Generator().manual_seed(seed)


def weights(network):
    return torch.cat([weight.detach().flatten() for weight in network.parameters()])


def test_depth_counts_hidden_layers_and_the_last_layer_has_no_relu(generator):
    network = Perceptron(FieldSettings(2, 16), generator)
    points = torch.randn(50, 3, generator=generator)
    first, second, last = network.linear_layers
    expected = last(second(first(points).relu()).relu())
    torch.testing.assert_close(network(points), expected)
    assert (expected < 0).any()


def test_eight_layers_of_the_paper():
    # 3*128 + 128 in, seven times 128*128 + 128 between, 128*3 + 3 out.
    field = Perceptron(preset("paper").field, seeded(0))
    assert weights(field).numel() == 512 + 7 * 16_512 + 387 == 116_483


def test_weights_start_after_xavier_and_biases_at_zero(generator):
    layers = Perceptron(FieldSettings(2, 64), generator).linear_layers
    for layer in layers:
        bound = math.sqrt(6 / (layer.in_features + layer.out_features))
        assert 0.8 * bound < layer.weight.abs().max() <= bound
        assert not layer.bias.any()


@pytest.mark.parametrize("num_rows", [0, 1, 4_097, 40_000])
def test_rows_in_pieces_give_the_same_as_at_once(num_rows, device, generator):
    network = Perceptron(SMALL, generator, 2).to(device)
    rows = torch.rand(num_rows, 2, device=device)
    flow = evaluate(network, rows)
    assert not flow.requires_grad
    torch.testing.assert_close(flow, network(rows).detach())


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
    for network in (exact, near):
        network(points).square().sum().backward()
    for of_exact, of_near in zip(exact.parameters(), near.parameters(), strict=True):
        assert of_near.dtype == of_near.grad.dtype == torch.float32
        assert (of_near.grad - of_exact.grad).norm() < 0.05 * of_exact.grad.norm()


def test_positions_and_flow_are_float32_in_any_precision():
    # The first and the last layer are all there is: a bfloat16 has 3 digits.
    points = torch.tensor([[80.001, -3.0, 0.5], [80.002, -3.0, 0.5]])
    exact, near = precise_pair(1)
    assert torch.equal(near(points), exact(points))
