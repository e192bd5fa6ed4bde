# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow field g(p; theta): a small network from positions to flow, fitted to two sweeps."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from mnsf_ros.settings import FieldSettings, FusionSettings

# Rows at once; on a CPU few enough for the layers to stay in the cache of a core.
_ROWS_AT_ONCE = {"cpu": 4_096, "cuda": 262_144}


class Perceptron(nn.Module):
    """A multilayer perceptron: (M, C) in, (M, 3) out, such as positions and flow in metres.

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
            settings: Number and width of the hidden layers.
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

    @property
    def linear_layers(self) -> list[nn.Linear]:
        """The layers, in order."""
        return [layer for layer in self._layers if isinstance(layer, nn.Linear)]

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """The output for each row.

        The first layer, which takes metres, and the last, which gives them, are as precise as
        their weights; those between have the precision.
        """
        first, *hidden, last = ((layer.weight, layer.bias) for layer in self.linear_layers)
        values = functional.linear(rows, *first)
        for weights, biases in hidden:
            values = functional.relu(values, inplace=True).to(self.precision)
            values = functional.linear(
                values, weights.to(self.precision), biases.to(self.precision)
            )
        values = functional.relu(values, inplace=True).to(last[0].dtype)
        return functional.linear(values, *last)


def _linear(num_inputs: int, num_outputs: int, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(num_inputs, num_outputs)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


@torch.no_grad()
def evaluate(network: nn.Module, rows: torch.Tensor) -> torch.Tensor:
    """Applies a network to rows (N, C), in pieces that bound the memory; (N, 3)."""
    return torch.cat([network(part) for part in rows.split(_ROWS_AT_ONCE[rows.device.type])])
