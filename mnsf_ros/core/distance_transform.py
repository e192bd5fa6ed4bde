"""Distance transform of a target sweep: a grid of distances, built once, looked up everywhere.

Section 2 of the paper, after FNSF. Exact (Euclidean) at the grid nodes, up to the rounding of the
target's points to nodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import edt
import numpy as np
import torch
from torch.nn import functional

_PADDING_CELLS = 2


@dataclass(frozen=True)
class GridBox:
    """Where the nodes of a grid are.

    Attributes:
        origin: Position of node (0, 0, 0), metres.
        shape: Number of nodes along x, y and z.
        cell_size_m: Distance between neighboring nodes.
    """

    origin: tuple[float, float, float]
    shape: tuple[int, int, int]
    cell_size_m: float

    @classmethod
    def around(cls, points: torch.Tensor, cell_size_m: float) -> GridBox:
        """The box around (N, 3) points, with a little padding."""
        low = points.min(dim=0).values.double().tolist()
        high = points.max(dim=0).values.double().tolist()
        first = [math.floor(value / cell_size_m) - _PADDING_CELLS for value in low]
        last = [math.ceil(value / cell_size_m) + _PADDING_CELLS for value in high]
        x, y, z = (node * cell_size_m for node in first)
        nx, ny, nz = (b - a + 1 for a, b in zip(first, last, strict=True))
        return cls((x, y, z), (nx, ny, nz), cell_size_m)

    @property
    def num_cells(self) -> int:
        """Number of nodes; each takes 4 bytes."""
        return math.prod(self.shape)


class DistanceTransform:
    """Distances to a sweep on a grid, interpolated trilinearly between the nodes."""

    kind = "grid"

    def __init__(self, distances: torch.Tensor, box: GridBox) -> None:
        self._distances = distances  # [nx, ny, nz]
        self._low = distances.new_tensor(box.origin)
        steps = distances.new_tensor(box.shape) - 1
        self._high = self._low + steps * box.cell_size_m

    @classmethod
    def from_points(cls, points: torch.Tensor, box: GridBox) -> DistanceTransform:
        """Builds the transform, with as many threads as torch has.

        Args:
            points: (N, 3) float32, metres, inside the box. Its device holds the result.
            box: The grid.
        """
        origin = np.array(box.origin)
        nodes = np.rint((points.cpu().numpy() - origin) / box.cell_size_m).astype(np.int64)
        is_free = np.ones(box.shape, dtype=np.uint8)
        is_free[nodes[:, 0], nodes[:, 1], nodes[:, 2]] = 0
        distances = edt.edt(
            is_free, anisotropy=(box.cell_size_m,) * 3, parallel=torch.get_num_threads()
        )
        return cls(torch.from_numpy(distances).to(points.device), box)

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """Distance of positions to the sweep.

        Outside the grid it is the distance to the grid plus what the grid says there: never less
        than the true distance, up to the rounding to cells, and still pulling back inside.

        Args:
            positions: (M, 3) metres.

        Returns:
            (M,) metres, differentiable.
        """
        inside = torch.minimum(torch.maximum(positions, self._low), self._high)
        unit = 2 * (inside - self._low) / (self._high - self._low) - 1  # [M, 3] in -1..1
        looked_up = functional.grid_sample(
            self._distances[None, None],
            unit.flip(1)[None, None, None],  # grid_sample wants the last axis first
            mode="bilinear",
            padding_mode="border",
            align_corners=True,
        ).view(-1)
        beyond: torch.Tensor = torch.linalg.vector_norm(positions - inside, dim=1)
        return looked_up + beyond
