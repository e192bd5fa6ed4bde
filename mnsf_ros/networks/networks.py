# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The networks of the paper: the flow field g(p; theta), and the fusion of flows.

g_invert and g_fusion are steps 3 and 4 of section 3: forward flow f and inverted backward flow f'
become one flow. With more than three sweeps there are more inverted flows, all fused at once.
"""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from mnsf_ros.settings import FieldSettings, FusionSettings

# Encoded positions: the shortest wavelength, four times the width of a pedestrian, and the unit of
# x, y and z, for inputs of about 1.
_SHORTEST_M = 2.0
_UNIT_M = 10.0

# Rows at once; on a CPU few enough for the layers to stay in the cache of a core.
_ROWS_AT_ONCE = {"cpu": 4_096, "cuda": 262_144}


class Perceptron(nn.Module):
    """A multilayer perceptron: (M, C) in, (M, 3) out, such as positions and flow in metres.

    Hidden layers are each followed by a ReLU, the output layer is not; the "8-layer" network of
    the paper has 8 hidden layers and 9 linear ones. Weights start uniformly after Xavier, from a
    generator on the CPU, biases at zero. Products between hidden layers have the `precision`.
    """

    def __init__(
        self,
        settings: FieldSettings | FusionSettings,
        generator: torch.Generator,
        num_inputs: int = 3,
        precision: torch.dtype = torch.float32,
    ) -> None:
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

    @torch.no_grad()
    def start_at_zero(self) -> "Perceptron":
        """Makes the output zero everywhere until the first step; returns itself."""
        self.linear_layers[-1].weight.zero_()
        return self

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """The output for each row; the first and the last layer are as precise as their weights."""
        first, *hidden, last = ((layer.weight, layer.bias) for layer in self.linear_layers)
        values = functional.linear(rows, *first)
        for weights, biases in hidden:
            values = functional.relu(values, inplace=True).to(self.precision)
            values = functional.linear(
                values, weights.to(self.precision), biases.to(self.precision)
            )
        values = functional.relu(values, inplace=True).to(last[0].dtype)
        return functional.linear(values, *last)


def num_encoded(num_octaves: int) -> int:
    """Number of columns of `encoded`."""
    return 3 + 4 * num_octaves


def encoded(positions: torch.Tensor, num_octaves: int) -> torch.Tensor:
    """Encodes positions (M, 3), metres, so that a network learns local changes of flow faster.

    Returns:
        (M, 3 + 4 num_octaves), about 1: x, y, z, then sines and cosines of x and y with wavelengths
        of 2 m, 4 m, 8 m ...
    """
    waves = _SHORTEST_M * 2.0 ** torch.arange(num_octaves, device=positions.device)
    angles = (2 * torch.pi * positions[:, None, :2] / waves[:, None]).flatten(1)
    return torch.cat([positions / _UNIT_M, angles.sin(), angles.cos()], dim=1)


def _linear(num_inputs: int, num_outputs: int, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(num_inputs, num_outputs)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


@torch.no_grad()
def evaluate(network: nn.Module, rows: torch.Tensor) -> torch.Tensor:
    """Applies a network to rows (N, C), in pieces that bound the memory; (N, 3)."""
    return torch.cat([network(part) for part in rows.split(_ROWS_AT_ONCE[rows.device.type])])


def invert_motion(backward_flow: torch.Tensor, interval_ratio: float = 1.0) -> torch.Tensor:
    """Inverts motion under the constant model of the paper (section 3): f' = -b.

    Flow is (N, 3) metres, from t to t-1, and from t to t+1. The ratio is the time from t to t+1
    over that from t-1 to t, 1 in the paper.
    """
    return -interval_ratio * backward_flow


class MlpFusion(Perceptron):
    """The fusion of the paper: a perceptron from (f, f') to the flow, shared by all points.

    As of all fusions, the input has K flows side by side, (M, 3 K) metres, the output is (M, 3).
    """

    def __init__(
        self,
        settings: FusionSettings,
        generator: torch.Generator,
        num_flows: int = 2,
        precision: torch.dtype = torch.float32,
    ) -> None:
        takes_sum = settings.input == "sum"
        super().__init__(settings, generator, 3 if takes_sum else 3 * num_flows, precision)
        self._takes_sum = takes_sum

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """Fuses flows."""
        return super().forward(_apart(flows).sum(dim=1) if self._takes_sum else flows)


class CorrectedMean(nn.Module):
    """The mean of the flows plus a correction by the fusion of the paper, zero at the start."""

    def __init__(self, correction: MlpFusion) -> None:
        super().__init__()
        self.correction = correction
        correction.start_at_zero()

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """Fuses flows."""
        return _apart(flows).mean(dim=1) + self.correction(flows)


class WeightedSumFusion(nn.Module):
    """W f + (I - W) f' with one learned 3 x 3 matrix W for all points; starts at the mean.

    Of K flows, each but the last has such a matrix; the last has the rest to I.
    """

    def __init__(self, num_flows: int = 2) -> None:
        super().__init__()
        # The matrices stand side by side.
        self._weights = nn.Parameter(torch.eye(3).repeat(1, num_flows - 1) / num_flows)

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """Fuses flows."""
        apart = _apart(flows)
        last = apart[:, -1]
        above_last = (apart[:, :-1] - last[:, None]).flatten(1)  # [M, 3 (K - 1)]
        return last + above_last @ self._weights.T


class MeanFusion(nn.Module):
    """(f + f') / 2. Nothing to learn."""

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """Fuses flows."""
        return _apart(flows).mean(dim=1)


def _apart(flows: torch.Tensor) -> torch.Tensor:
    return flows.view(len(flows), -1, 3)  # [M, K, 3]


def fusion_network(
    settings: FusionSettings,
    generator: torch.Generator,
    num_flows: int = 2,
    precision: torch.dtype = torch.float32,
) -> nn.Module:
    """A fresh fusion of `num_flows` flows, of the kind in the settings."""
    if settings.kind == "mlp":
        return MlpFusion(settings, generator, num_flows, precision)
    return WeightedSumFusion(num_flows) if settings.kind == "weighted_sum" else MeanFusion()
