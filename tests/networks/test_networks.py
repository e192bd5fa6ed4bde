# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The networks: depth, first weights and precision, encoded positions, a fusion from the mean."""

import math

import pytest
import torch

from mnsf_ros.networks.networks import (
    CorrectedMean,
    MlpFusion,
    Perceptron,
    encoded,
    evaluate,
    num_encoded,
)
from mnsf_ros.presets import preset
from mnsf_ros.settings import FieldSettings, FusionSettings

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


def test_a_network_that_starts_at_zero_learns_all_the_same(generator):
    network = Perceptron(SMALL, generator)
    assert network.start_at_zero() is network
    points = torch.randn(20, 3, generator=generator)
    assert not network(points).any()
    # Hidden layers start as they do; the first step is one of the last layer.
    assert all(layer.weight.any() for layer in network.linear_layers[:-1])
    (network(points) - 1).square().sum().backward()
    assert network.linear_layers[-1].weight.grad.any()


@pytest.mark.parametrize("input_", ["concat", "sum"])
def test_corrected_mean_is_the_mean_until_it_learns(generator, input_):
    settings = FusionSettings(input=input_, num_hidden_layers=2, hidden_width=8)
    fusion = CorrectedMean(MlpFusion(settings, generator))
    flows = torch.randn(50, 6, generator=generator)
    mean = (flows[:, :3] + flows[:, 3:]) / 2
    assert torch.equal(fusion(flows), mean)
    bias = fusion.correction.linear_layers[-1].bias
    with torch.no_grad():
        bias.copy_(torch.tensor([1.0, 0.0, -2.0]))
    torch.testing.assert_close(fusion(flows), mean + bias)


class TestEncoded:
    OCTAVES = 4

    def waves(self, positions):
        """(M, 4, O) sines of x and y, then cosines, of each octave."""
        rows = encoded(positions, self.OCTAVES)[:, 3:].reshape(len(positions), 2, self.OCTAVES, 2)
        return rows.movedim(2, 3).flatten(1, 2)

    @pytest.mark.parametrize("num_octaves", [0, 1, 7])
    def test_columns(self, device, generator, num_octaves):
        positions = (50 * torch.randn(9, 3, generator=generator)).to(device)
        rows = encoded(positions, num_octaves)
        assert rows.shape == (9, num_encoded(num_octaves)) == (9, 3 + 4 * num_octaves)
        assert (rows.dtype, rows.device) == (torch.float32, positions.device)
        torch.testing.assert_close(rows[:, :3], positions / 10)
        assert (rows[:, 3:].abs() <= 1).all()

    def test_sines_and_cosines_of_x_and_y(self):
        x, y = 2.0, 0.5
        expected = [
            [function(2 * math.pi * place / wave) for wave in (2, 4, 8, 16)]
            for function in (math.sin, math.cos)
            for place in (x, y)
        ]
        waves = self.waves(torch.tensor([[x, y, 3.0]]))[0]
        torch.testing.assert_close(waves, torch.tensor(expected), atol=1e-6, rtol=0)

    @pytest.mark.parametrize("axis", [0, 1])
    @pytest.mark.parametrize("octave", range(OCTAVES))
    def test_repeat_after_their_wavelength_and_not_before(self, generator, axis, octave):
        positions = 10 * torch.randn(40, 3, generator=generator)
        for share, repeats in ((1.0, True), (0.5, False)):
            moved = positions.clone()
            moved[:, axis] += share * 2.0 * 2**octave
            apart = (self.waves(moved) - self.waves(positions))[:, :, octave].abs()
            # The other coordinate is encoded by itself.
            assert not apart[:, [1 - axis, 3 - axis]].any()
            assert (apart.max() < 1e-4) == repeats

    def test_not_of_the_height(self, generator):
        positions = torch.randn(5, 3, generator=generator)
        raised = positions + torch.tensor([0.0, 0.0, 1.3])
        assert torch.equal(self.waves(raised), self.waves(positions))
