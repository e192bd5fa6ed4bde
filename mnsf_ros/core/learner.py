# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A network with its optimizer, and the kinds of loss."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import torch
from torch import nn


@dataclass
class Learner:
    """A network with its optimizer, so that both can be carried from triplet to triplet.

    Attributes:
        network: The network, or a list of several.
        optimizer: Adam over the network's weights, with its moments; None if it has no weights.
        last_loss: Loss at the end of the last optimization, metres; None for a fresh network.
        num_networks: Number of networks in a stack, whose weights have them as first axis.
    """

    network: nn.Module
    optimizer: torch.optim.Adam | None
    last_loss: float | None = None
    num_networks: int = 1

    @classmethod
    def fresh(cls, network: nn.Module, weight_decay: float = 0.0) -> Learner:
        """A learner whose optimizer has taken no step yet."""
        weights = list(network.parameters())
        if not weights:
            return cls(network, None)
        return cls(network, adam(weights, weight_decay))


@dataclass(frozen=True)
class PartlyJudgedLoss:
    """Sum of losses, and the one loss for early stopping.

    Attributes:
        total: The sum to minimize; the weights of its lowest value are the best ones.
        judged: The loss for early stopping.
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
