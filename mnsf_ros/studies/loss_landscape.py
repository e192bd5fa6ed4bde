"""The loss around an optimum, along directions that are scaled to the weights.

A step along a direction is measured in the size of the weights themselves ("filter normalization",
Li et al. 2018): every row of a weight matrix of the direction has the length of that row of the
optimum, and biases stay. Without that, networks of different scale could not be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

Direction = list[torch.Tensor]


def random_direction(network: nn.Module, generator: torch.Generator) -> Direction:
    """Returns a filter-normalized random direction, one tensor for each parameter.

    Args:
        network: Gives the shapes and the lengths.
        generator: Source of randomness, on the CPU.
    """
    return [_normalized(weights.detach(), generator) for weights in network.parameters()]


@torch.no_grad()
def losses_along(
    network: nn.Module,
    loss_of: Callable[[], torch.Tensor],
    directions: Sequence[Direction],
    steps: Sequence[Sequence[float]],
) -> NDArray[np.float64]:
    """Returns the loss at places around the network's weights, which are left as they are.

    Args:
        network: At its optimum.
        loss_of: Computes the loss of the network as it is now.
        directions: D directions.
        steps: S places, each D steps along the directions.

    Returns:
        (S,) losses.
    """
    weights = list(network.parameters())
    optimum = [item.clone() for item in weights]
    losses = []
    try:
        for place in steps:
            for number, item in enumerate(weights):
                item.copy_(optimum[number])
                for step, direction in zip(place, directions, strict=True):
                    item.add_(direction[number], alpha=step)
            losses.append(float(loss_of()))
    finally:
        for item, before in zip(weights, optimum, strict=True):
            item.copy_(before)
    return np.array(losses)


@dataclass(frozen=True, eq=False)
class Landscape:
    """The loss on a square around an optimum, and how fast it rises in all directions.

    Attributes:
        axis: (G,) steps of the square, symmetric, 0 in the middle.
        losses_m: (G, G) loss, rows along the second direction.
        loss_m: Loss at the optimum.
        radii: (R,) lengths of steps along random directions.
        rises_m: (M, R) mean rise of the loss a step forth and back along each of M directions.
    """

    axis: NDArray[np.float64]
    losses_m: NDArray[np.float64]
    loss_m: float
    radii: NDArray[np.float64]
    rises_m: NDArray[np.float64]

    @property
    def sharpness(self) -> NDArray[np.float64]:
        """(R,) mean rise over all directions, metres."""
        mean: NDArray[np.float64] = self.rises_m.mean(axis=0)
        return mean


def landscape(
    network: nn.Module,
    loss_of: Callable[[], torch.Tensor],
    *,
    seed: int,
    radius: float,
    num_steps: int,
    num_directions: int,
) -> Landscape:
    """Measures the loss around the weights of a network.

    Args:
        network: At its optimum.
        loss_of: Computes its loss.
        seed: Of the directions.
        radius: The square reaches so far to each side; 1: as far as the weights are long.
        num_steps: Steps from one side of the square to the other, an odd number.
        num_directions: Random directions for the sharpness.
    """
    generator = torch.Generator().manual_seed(seed)
    pair = [random_direction(network, generator) for _ in range(2)]
    axis = np.linspace(-radius, radius, num_steps, dtype=np.float64)
    places = [(x, y) for y in axis for x in axis]
    losses_m = losses_along(network, loss_of, pair, places).reshape(num_steps, num_steps)
    radii = radius * np.array([0.1, 0.2, 0.5, 1.0])
    loss_m = float(losses_along(network, loss_of, [], [()])[0])
    rises_m = []
    for _ in range(num_directions):
        direction = random_direction(network, generator)
        there_and_back = [(sign * step,) for step in radii for sign in (1.0, -1.0)]
        losses = losses_along(network, loss_of, [direction], there_and_back)
        rises_m.append(losses.reshape(-1, 2).mean(axis=1) - loss_m)
    return Landscape(axis, losses_m, loss_m, radii, np.array(rises_m))


def _normalized(weights: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    if weights.ndim < 2:
        return torch.zeros_like(weights)
    drawn = torch.randn(weights.shape, generator=generator).to(weights.device)
    lengths = torch.linalg.vector_norm(weights.flatten(1), dim=1)
    drawn_lengths = torch.linalg.vector_norm(drawn.flatten(1), dim=1).clamp(min=1e-12)
    scales = (lengths / drawn_lengths).view(-1, *[1] * (weights.ndim - 1))
    normalized: torch.Tensor = drawn * scales
    return normalized
