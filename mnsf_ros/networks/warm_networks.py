# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""g_f, g_b and g_fusion of a stream: weights that live from triplet to triplet."""

from typing import Final

import numpy as np
import torch
from torch import nn

from mnsf_ros.core.compute_device import compute_device, layer_precision
from mnsf_ros.core.flow_estimate import OptimizationResult
from mnsf_ros.networks.networks import (
    CorrectedMean,
    MlpFusion,
    Perceptron,
    encoded,
    evaluate,
    fusion_network,
    invert_motion,
    num_encoded,
)
from mnsf_ros.networks.optimization import LossOf, Schedule, minimize
from mnsf_ros.settings import Settings

STAGES: Final = ("forward", "backward", "fusion")


class WarmNetworks:
    """The three networks of the paper, on the device of the settings. At first they give zero flow.

    Attributes:
        networks: Stage to network: `forward` and `backward` from encoded positions to flow,
            `fusion` from both flows to one. Flow is in metres for one interval, the same for all.
        fitted: The stages that were fitted before.
        random: Chooses the points of each step.
    """

    def __init__(self, settings: Settings) -> None:
        self._num_octaves = settings.live.num_octaves
        self.fitted: set[str] = set()
        self.random = np.random.default_rng(settings.compute.seed)
        generator = torch.Generator().manual_seed(settings.compute.seed)
        precision = layer_precision(settings.compute)
        num_inputs = num_encoded(self._num_octaves)
        forward, backward = (
            Perceptron(settings.field, generator, num_inputs, precision).start_at_zero()
            for _ in range(2)
        )
        fusion = fusion_network(settings.fusion, generator, precision=precision)
        if isinstance(fusion, MlpFusion):
            fusion = CorrectedMean(fusion)
        device = compute_device(settings.compute)
        parts = (part.to(device) for part in (forward, backward, fusion))
        self.networks: dict[str, nn.Module] = dict(zip(STAGES, parts, strict=True))

    def encoded(self, positions: torch.Tensor) -> torch.Tensor:
        """Input of both fields: (M, 3) metres to (M, C)."""
        return encoded(positions, self._num_octaves)

    def fit(self, stage: str, loss_of: LossOf, schedule: Schedule) -> OptimizationResult:
        """Optimizes one of the networks further, see `minimize`."""
        result = minimize(self.networks[stage], loss_of, schedule)
        self.fitted.add(stage)
        return result

    def flows(self, inputs: torch.Tensor) -> torch.Tensor:
        """Both flows, f and f' = -b, side by side: (M, C) encoded positions to (M, 6) metres."""
        forward, backward = (evaluate(self.networks[stage], inputs) for stage in STAGES[:2])
        return torch.cat([forward, invert_motion(backward)], dim=1)

    def flow(self, inputs: torch.Tensor, *, has_backward: bool) -> torch.Tensor:
        """The flow to t+1, (M, 3) metres: fused, or the forward one if it is the only one."""
        if not has_backward:
            return evaluate(self.networks["forward"], inputs)
        return evaluate(self.networks["fusion"], self.flows(inputs))
