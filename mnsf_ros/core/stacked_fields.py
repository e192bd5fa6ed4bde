"""Several flow fields as one network, so that a device computes them all at once."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

from mnsf_ros.core.flow_field import FlowField


class StackedFields(nn.Module):
    """K fields of one shape: (M, 3) metres in, (K, M, 3) metres out.

    It shares its weights with the fields: what is fitted in one is fitted in the other.
    """

    def __init__(self, fields: Sequence[FlowField]) -> None:
        """Takes over the weights of the fields, which are on their device already."""
        super().__init__()
        self._weights, self._biases = nn.ParameterList(), nn.ParameterList()
        for layers in zip(*(field.linear_layers() for field in fields), strict=True):
            weights = torch.stack([layer.weight.detach().T for layer in layers])  # [K, in, out]
            biases = torch.stack([layer.bias.detach() for layer in layers])[:, None]
            self._weights.append(nn.Parameter(weights))
            self._biases.append(nn.Parameter(biases))
            for layer, weight, bias in zip(layers, weights, biases, strict=True):
                layer.weight.data, layer.bias.data = weight.T, bias[0]

    def forward(self, positions: torch.Tensor) -> torch.Tensor:
        """Flow of each field at the positions."""
        values = positions.expand(len(self._weights[0]), -1, -1)
        for number, (weights, biases) in enumerate(zip(self._weights, self._biases, strict=True)):
            if number:
                values = functional.relu(values, inplace=True)
            values = torch.baddbmm(biases, values, weights)
        return values
