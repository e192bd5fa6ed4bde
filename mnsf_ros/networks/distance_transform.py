# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The distance transform of a sweep on a grid: built once, looked up everywhere.

Exact (Euclidean) at the grid nodes, up to the rounding of points to nodes.
"""

import math

import edt
import numpy as np
import torch
from torch.nn import functional

from mnsf_ros.core.compute_device import on_device

_PADDING_CELLS = 2


def nodes_around(
    points: torch.Tensor, cell_size_m: float
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Returns the numbers of the first node and of all nodes along x, y, z around (N, 3) points."""
    low = points.min(dim=0).values.double().tolist()
    high = points.max(dim=0).values.double().tolist()
    first = tuple(math.floor(value / cell_size_m) - _PADDING_CELLS for value in low)
    last = (math.ceil(value / cell_size_m) + _PADDING_CELLS for value in high)
    return first, tuple(b - a + 1 for a, b in zip(first, last, strict=True))


def between_nodes(values: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
    """Interpolates C values trilinearly; differentiable, and outside the grid that of its border.

    Args:
        values: (C, nx, ny, nz), at the nodes of a grid.
        unit: (M, 3) places in the grid, from -1 at the first node of an axis to 1 at the last one.

    Returns:
        (C, M).
    """
    places = unit.flip(1)[None, None, None]  # grid_sample wants the last axis first
    return functional.grid_sample(
        values[None], places, mode="bilinear", padding_mode="border", align_corners=True
    ).view(len(values), -1)


class DistanceTransform:
    """Distances to a sweep on a grid, interpolated trilinearly between the nodes.

    Attributes:
        distances: (nx, ny, nz) float32, metres, at the nodes, on the device of the points.
        low: (3,) metres, the first node.
        high: (3,) metres, the last node.
    """

    kind = "grid"

    def __init__(self, points: torch.Tensor, cell_size_m: float) -> None:
        """Builds the transform to (N, 3) points, metres, with torch's threads."""
        first, shape = nodes_around(points, cell_size_m)
        origin = np.array([node * cell_size_m for node in first])
        nodes = np.rint((points.cpu().numpy() - origin) / cell_size_m).astype(np.int64)
        is_free = np.ones(shape, dtype=np.uint8)
        is_free[nodes[:, 0], nodes[:, 1], nodes[:, 2]] = 0
        threads = torch.get_num_threads()
        distances = edt.edt(is_free, anisotropy=(cell_size_m,) * 3, parallel=threads)
        self.distances = on_device(distances, points.device)
        self.low = self.distances.new_tensor(origin.tolist())
        self.high = self.low + (self.distances.new_tensor(shape) - 1) * cell_size_m

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """Distances (M,) of positions (M, 3) to the sweep, metres, differentiable.

        Outside the grid it is the distance to the grid plus the value at its border: never less
        than the true distance, up to the rounding to cells, and still pulling back inside.
        """
        inside = torch.minimum(torch.maximum(positions, self.low), self.high)
        unit = 2 * (inside - self.low) / (self.high - self.low) - 1
        looked_up = between_nodes(self.distances[None], unit).view(-1)
        beyond: torch.Tensor = torch.linalg.vector_norm(positions - inside, dim=1)
        return looked_up + beyond
