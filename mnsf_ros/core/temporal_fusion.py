# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""g_invert and g_fusion: forward flow f and inverted backward flow f' become one flow.

Steps 3 and 4 of section 3 of the paper. With more than three sweeps there are more inverted flows;
all of them are fused at once.
"""

from __future__ import annotations

import torch
from torch import nn

from mnsf_ros.core.flow_field import Perceptron
from mnsf_ros.settings import FusionSettings


def invert_motion(backward_flow: torch.Tensor, interval_ratio: float = 1.0) -> torch.Tensor:
    """Inverts motion under the constant model of the paper (section 3): f' = -b.

    Args:
        backward_flow: (N, 3) metres, from t to t-1.
        interval_ratio: Time from t to t+1 over time from t-1 to t. With equal intervals, as in
            the paper, this is 1; a point of constant velocity moves that much farther.

    Returns:
        (N, 3) metres, from t to t+1.
    """
    return -interval_ratio * backward_flow


class MlpFusion(nn.Module):
    """The fusion of the paper: a perceptron from (f, f') to the flow, shared by all points."""

    def __init__(
        self,
        settings: FusionSettings,
        generator: torch.Generator,
        num_flows: int = 2,
        precision: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        self._takes_sum = settings.input == "sum"
        num_inputs = 3 if self._takes_sum else 3 * num_flows
        self._layers = Perceptron(settings, generator, num_inputs, precision)

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """(M, 3 K) metres, the K flows side by side, to (M, 3) metres."""
        inputs = _apart(flows).sum(dim=1) if self._takes_sum else flows
        fused: torch.Tensor = self._layers(inputs)
        return fused


class WeightedSumFusion(nn.Module):
    """W f + (I - W) f' with one learned 3 x 3 matrix W for all points; starts at the mean.

    Of K flows each but the last has such a matrix, and the last gets what is left.
    """

    def __init__(self, num_flows: int = 2) -> None:
        super().__init__()
        # The matrices stand side by side.
        self._weights = nn.Parameter(torch.eye(3).repeat(1, num_flows - 1) / num_flows)

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """(M, 3 K) metres, the K flows side by side, to (M, 3) metres."""
        apart = _apart(flows)
        last = apart[:, -1]
        above_last = (apart[:, :-1] - last[:, None]).flatten(1)  # [M, 3 (K - 1)]
        fused: torch.Tensor = last + above_last @ self._weights.T
        return fused


class MeanFusion(nn.Module):
    """(f + f') / 2. Nothing to learn."""

    def forward(self, flows: torch.Tensor) -> torch.Tensor:
        """(M, 3 K) metres, the K flows side by side, to (M, 3) metres."""
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
