"""The network of a field: what its depth counts, and where its first weights come from."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from mnsf_ros.core.flow_field import FlowField, perceptron
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings


def seeded(seed):
    return torch.Generator().manual_seed(seed)


def weights(network):
    return torch.cat([weight.detach().flatten() for weight in network.parameters()])


@pytest.mark.parametrize("num_hidden_layers", [1, 3, 8])
def test_depth_counts_hidden_layers(num_hidden_layers):
    layers = list(perceptron(3, num_hidden_layers, 16, seeded(0)))
    assert [type(layer) for layer in layers] == [nn.Linear, nn.ReLU] * num_hidden_layers + [
        nn.Linear
    ]
    inputs = [3] + [16] * num_hidden_layers
    assert [layer.in_features for layer in layers[::2]] == inputs
    assert [layer.out_features for layer in layers[::2]] == [*inputs[1:], 3]


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
    first = weights(perceptron(3, 2, 8, seeded(0)))
    torch.manual_seed(2)
    assert torch.equal(first, weights(perceptron(3, 2, 8, seeded(0))))


def test_layers_of_one_network_differ(generator):
    network = perceptron(3, 4, 16, generator)
    assert not torch.equal(network[2].weight, network[4].weight)


def test_weights_start_after_xavier_and_biases_at_zero(generator):
    for layer in perceptron(3, 2, 64, generator)[::2]:
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
