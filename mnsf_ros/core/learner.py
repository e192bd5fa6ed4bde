# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A network with its optimizer, and what its loss may be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import torch
from torch import nn

from mnsf_ros.errors import OptimizationError


@dataclass
class Learner:
    """A network with its optimizer, so that both can be carried from triplet to triplet.

    Attributes:
        network: What is optimized.
        optimizer: Adam over the network's weights, with its moments; None if it has no weights.
        last_loss: Loss at the end of the last optimization, metres; None for a fresh network.
        num_networks: Networks that are one stack; then the weights' first axis is that of the
            networks.
    """

    network: nn.Module
    optimizer: torch.optim.Adam | None
    last_loss: float | None = None
    num_networks: int = 1

    @classmethod
    def fresh(cls, network: nn.Module, weight_decay: float = 0.0) -> Learner:
        """A learner whose optimizer has seen nothing yet."""
        weights = list(network.parameters())
        if not weights:
            return cls(network, None)
        return cls(network, adam(weights, weight_decay))


@dataclass(frozen=True)
class PartlyJudgedLoss:
    """A sum of losses of which one alone decides when to stop.

    Attributes:
        total: What is made small; the weights of its lowest value are the best ones.
        judged: What early stopping looks at.
    """

    total: torch.Tensor
    judged: torch.Tensor


# Computes the loss of a network as it is now, a scalar, or of K networks (K,).
LossOf = Callable[[], torch.Tensor | PartlyJudgedLoss]


def adam(weights: Iterable[nn.Parameter], weight_decay: float = 0.0) -> torch.optim.Adam:
    """Adam over the weights of networks, whose step size is set before each step."""
    weights = list(weights)
    # Fused: one pass over all weights; for networks this small that is a tenth of a step.
    # Capturable: on CUDA a step can be recorded.
    return torch.optim.Adam(
        weights, weight_decay=weight_decay, fused=True, capturable=weights[0].is_cuda
    )


def checked_loss(loss: float) -> float:
    """Returns the loss of an optimization that has ended.

    Raises:
        OptimizationError: If it is not finite.
    """
    if not math.isfinite(loss):
        raise OptimizationError(f"the loss became {loss}, expected a finite number of metres")
    return loss
