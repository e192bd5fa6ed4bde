"""The flow field g(p; theta): a small network from positions to flow, fitted to two sweeps."""

from __future__ import annotations

import torch
from torch import nn

from mnsf_ros.settings import FieldSettings


def perceptron(
    num_inputs: int,
    num_hidden_layers: int,
    hidden_width: int,
    generator: torch.Generator,
) -> nn.Sequential:
    """A multilayer perceptron with three outputs.

    Hidden layers are each followed by a ReLU, the output layer is not; the "8-layer" network of
    the paper has 8 hidden layers and 9 linear ones. Weights start uniformly after Xavier, biases
    at zero.

    Args:
        num_inputs: Columns of the input.
        num_hidden_layers: Linear layers before the output layer.
        hidden_width: Neurons of each of them.
        generator: Source of the start weights, on the CPU.
    """
    layers: list[nn.Module] = []
    width = num_inputs
    for _ in range(num_hidden_layers):
        layers += [_linear(width, hidden_width, generator), nn.ReLU()]
        width = hidden_width
    return nn.Sequential(*layers, _linear(width, 3, generator))


def _linear(num_inputs: int, num_outputs: int, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(num_inputs, num_outputs)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


def start_at_zero(network: nn.Sequential) -> None:
    """Makes the output of a fresh perceptron zero, whatever its input."""
    for weights in network[-1].parameters():
        nn.init.zeros_(weights)


class FlowField(nn.Module):
    """Flow at any position: (M, 3) metres in, (M, 3) metres out.

    With one more input, the time in sweep intervals, it is the flow at any position and time.
    """

    def __init__(
        self, settings: FieldSettings, generator: torch.Generator, num_inputs: int = 3
    ) -> None:
        super().__init__()
        self._layers = perceptron(
            num_inputs, settings.num_hidden_layers, settings.hidden_width, generator
        )
        if settings.zero_start:
            start_at_zero(self._layers)

    def linear_layers(self) -> list[nn.Linear]:
        """The layers with weights, in order."""
        return [layer for layer in self._layers if isinstance(layer, nn.Linear)]

    def forward(self, positions: torch.Tensor) -> torch.Tensor:
        """Flow at the positions, or at positions and times."""
        flow: torch.Tensor = self._layers(positions)
        return flow
