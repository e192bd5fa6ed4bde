"""g_fusion: forward flow f and inverted backward flow f' become one flow (section 3, step 4)."""

from __future__ import annotations

import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.flow_field import perceptron
from mnsf_ros.core.optimization import Learner, OptimizationResult, minimize
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.settings import FusionSettings


class MlpFusion(nn.Module):
    """The fusion of the paper: a perceptron from (f, f') to the flow, shared by all points."""

    def __init__(self, settings: FusionSettings, generator: torch.Generator) -> None:
        super().__init__()
        self._layers = perceptron(6, settings.num_hidden_layers, settings.hidden_width, generator)

    def forward(self, both_flows: torch.Tensor) -> torch.Tensor:
        """(M, 6) metres, f beside f', to (M, 3) metres."""
        fused: torch.Tensor = self._layers(both_flows)
        return fused


class WeightedSumFusion(nn.Module):
    """W f + (I - W) f' with one learned 3 x 3 matrix W for all points; starts at the mean."""

    def __init__(self) -> None:
        super().__init__()
        self._weight = nn.Parameter(0.5 * torch.eye(3))

    def forward(self, both_flows: torch.Tensor) -> torch.Tensor:
        """(M, 6) metres, f beside f', to (M, 3) metres."""
        forward_flow, inverted = both_flows[:, :3], both_flows[:, 3:]
        fused: torch.Tensor = inverted + (forward_flow - inverted) @ self._weight.T
        return fused


class MeanFusion(nn.Module):
    """(f + f') / 2. Nothing to learn."""

    def forward(self, both_flows: torch.Tensor) -> torch.Tensor:
        """(M, 6) metres, f beside f', to (M, 3) metres."""
        return 0.5 * (both_flows[:, :3] + both_flows[:, 3:])


def fusion_network(settings: FusionSettings, generator: torch.Generator) -> nn.Module:
    """A fresh fusion of the kind that the settings ask for."""
    if settings.kind == "mlp":
        return MlpFusion(settings, generator)
    return WeightedSumFusion() if settings.kind == "weighted_sum" else MeanFusion()


def fit_fusion(
    fusion: Learner, batches: Batches, target: TargetDistance, schedule: Schedule
) -> OptimizationResult:
    """Makes the fused flow move the current points onto the next sweep.

    Minimizes mean D(p + g_fusion(f, f'), S3); f and f' are fixed.

    Args:
        fusion: The fusion to fit, in place.
        batches: Rows (M, 9): point, forward flow, inverted backward flow, metres.
        target: Distance to the next sweep.
        schedule: How long and with which steps.

    Raises:
        OptimizationError: If the loss is not finite.
        CancelledError: If the schedule says so.
    """

    def loss_of() -> torch.Tensor:
        rows = batches.draw()
        return target.mean(rows[:, :3] + fusion.network(rows[:, 3:]))

    return minimize(fusion, loss_of, schedule, keep_best=batches.are_whole)
