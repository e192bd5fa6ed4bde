# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow field g(p; theta): a small network from positions to flow, fitted to two sweeps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from mnsf_ros.settings import FieldSettings, FusionSettings


class Perceptron(nn.Module):
    """A multilayer perceptron with three outputs: (M, C) in, (M, 3) out.

    Hidden layers are each followed by a ReLU, the output layer is not; the "8-layer" network of
    the paper has 8 hidden layers and 9 linear ones. Weights start uniformly after Xavier, biases
    at zero.

    Attributes:
        precision: Of the products between hidden layers, see `layer_precision`.
    """

    def __init__(
        self,
        settings: FieldSettings | FusionSettings,
        generator: torch.Generator,
        num_inputs: int = 3,
        precision: torch.dtype = torch.float32,
    ) -> None:
        """Makes a fresh network.

        Args:
            settings: Number and width of the hidden layers, and whether the initial output is
                zero.
            generator: Source of the start weights, on the CPU.
            num_inputs: Columns of the input.
            precision: Of the products between hidden layers.
        """
        super().__init__()
        widths = [num_inputs, *[settings.hidden_width] * settings.num_hidden_layers, 3]
        self._layers = nn.ModuleList(
            _linear(before, after, generator) for before, after in pairwise(widths)
        )
        self.precision = precision
        if settings.zero_start:
            nn.init.zeros_(self.linear_layers[-1].weight)

    @property
    def linear_layers(self) -> list[nn.Linear]:
        """The layers, in order."""
        return [layer for layer in self._layers if isinstance(layer, nn.Linear)]

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """The output for each row."""
        layers = [(layer.weight, layer.bias) for layer in self.linear_layers]
        return _through(rows, layers, functional.linear, self.precision)


def _linear(num_inputs: int, num_outputs: int, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(num_inputs, num_outputs)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


class FlowField(Perceptron):
    """Flow at any position: (M, 3) metres in, (M, 3) metres out.

    With one more input, the time in sweep intervals, it is the flow at any position and time.
    """


class StackedFields(nn.Module):
    """K fields of one shape as one network, computed at once: (M, 3) in, (K, M, 3) out, metres.

    It shares its weights with the fields.
    """

    def __init__(self, fields: Sequence[FlowField]) -> None:
        """Takes over the weights of the fields, which are on their device already."""
        super().__init__()
        self._precision = fields[0].precision
        self._weights, self._biases = nn.ParameterList(), nn.ParameterList()
        for layers in zip(*(field.linear_layers for field in fields), strict=True):
            weights = torch.stack([layer.weight.detach().T for layer in layers])  # [K, in, out]
            biases = torch.stack([layer.bias.detach() for layer in layers])[:, None]
            self._weights.append(nn.Parameter(weights))
            self._biases.append(nn.Parameter(biases))
            for layer, weight, bias in zip(layers, weights, biases, strict=True):
                layer.weight.data, layer.bias.data = weight.T, bias[0]

    def forward(self, positions: torch.Tensor) -> torch.Tensor:
        """Flow of each field at the positions."""
        values = positions.expand(len(self._weights[0]), -1, -1)
        layers = zip(self._weights, self._biases, strict=True)
        return _through(values, layers, _products, self._precision)


def _products(values: torch.Tensor, weights: torch.Tensor, biases: torch.Tensor) -> torch.Tensor:
    return torch.baddbmm(biases, values, weights)


def _through(
    values: torch.Tensor,
    layers: Iterable[tuple[torch.Tensor, torch.Tensor]],
    linear: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor],
    precision: torch.dtype,
) -> torch.Tensor:
    """Values through linear layers (weights, biases), with a ReLU after each but the last.

    The first layer, which takes metres, and the last, which gives them, are as precise as their
    weights; those between have the precision.
    """
    first, *hidden, last = layers
    values = linear(values, *first)
    for weights, biases in hidden:
        values = functional.relu(values, inplace=True).to(precision)
        values = linear(values, weights.to(precision), biases.to(precision))
    values = functional.relu(values, inplace=True).to(last[0].dtype)
    return linear(values, *last)
