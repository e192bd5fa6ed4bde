# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S): the distance of positions to a target sweep, by a distance transform or a search.

Section 2 of the paper, after FNSF. The distance transform is a grid of distances, built once and
looked up everywhere, exact (Euclidean) at the grid nodes up to the rounding of points to nodes.
"""

import math

import edt
import numpy as np
import torch
from scipy.spatial import cKDTree
from torch.nn import functional

from mnsf_ros.core.compute_device import on_device
from mnsf_ros.settings import DistanceSettings

_PADDING_CELLS = 2

# Pairs of a CUDA search that are in memory at once: 512 MiB of float64.
_MAX_PAIRS = 64 * 1024 * 1024


class TargetDistance:
    """Distance to a target sweep, differentiable in the positions."""

    def __init__(
        self, lookup: "DistanceTransform | NearestNeighborDistance", truncation_m: float = 0.0
    ) -> None:
        self._lookup = lookup
        self._truncation_m = truncation_m

    @classmethod
    def to_points(cls, points: torch.Tensor, settings: DistanceSettings) -> "TargetDistance":
        """Builds the distance to a sweep as the settings ask.

        A grid that would be too large for memory, as one stray point far away makes it, is
        replaced by the tree, which costs the same for any extent.

        Args:
            points: (N, 3) float32, metres, the target sweep.
            settings: Kind, cell size, the largest grid allowed, the truncation.
        """
        if settings.kind == "grid":
            _, shape = nodes_around(points, settings.cell_size_m)
            if math.prod(shape) <= settings.max_cells:
                grid = DistanceTransform(points, settings.cell_size_m)
                return cls(grid, settings.truncation_m)
        return cls(NearestNeighborDistance(points), settings.truncation_m)

    @property
    def kind(self) -> str:
        """`grid` or `tree`."""
        return self._lookup.kind

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres, in the target's frame, to (M,) metres."""
        distances = self._lookup(positions)
        return distances.clamp(max=self._truncation_m) if self._truncation_m else distances

    def mean(self, positions: torch.Tensor) -> torch.Tensor:
        """The loss of the paper: mean distance of the moved points to the sweep, metres."""
        return self(positions).mean()


class NearestNeighborDistance:
    """Distance to the nearest target point: a k-d tree on the CPU, brute force on CUDA."""

    kind = "tree"

    def __init__(self, points: torch.Tensor) -> None:
        self._points = points
        self._tree = None if points.is_cuda else cKDTree(points.nan_to_num().numpy())

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres to (M,) metres; the gradient pulls toward the nearest point."""
        nearest = self._points[self.nearest_indices(positions.detach())]
        return torch.linalg.vector_norm(positions - nearest, dim=1)

    def nearest_indices(self, positions: torch.Tensor) -> torch.Tensor:
        """Row of the nearest target point: (M, 3) metres, without gradient, to (M,)."""
        if self._tree is not None:
            # The tree refuses NaN and infinity; any neighbour will do for a distance that is none.
            _, indices = self._tree.query(positions.nan_to_num().numpy())
            return torch.from_numpy(indices)
        # The nearest q has the smallest |q|^2 - 2 p q: one matrix product. In float32 it would be
        # wrong for neighbours far from the origin.
        points = self._points.double()
        squares = points.square().sum(dim=1)
        chunk = max(1, _MAX_PAIRS // len(points))
        return torch.cat(
            [
                torch.addmm(squares, part, points.T, alpha=-2).argmin(dim=1)
                for part in positions.double().split(chunk)
            ]
        )


def nodes_around(
    points: torch.Tensor, cell_size_m: float
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Returns the numbers of the first node and of all nodes along x, y, z around (N, 3) points."""
    low = points.min(dim=0).values.double().tolist()
    high = points.max(dim=0).values.double().tolist()
    first = tuple(math.floor(value / cell_size_m) - _PADDING_CELLS for value in low)
    last = (math.ceil(value / cell_size_m) + _PADDING_CELLS for value in high)
    return first, tuple(b - a + 1 for a, b in zip(first, last, strict=True))


class DistanceTransform:
    """Distances to a sweep on a grid, interpolated trilinearly between the nodes.

    Attributes:
        distances: (nx, ny, nz) float32, metres, those of the nodes, on the device of the points.
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
        """Distance of positions to the sweep.

        Outside the grid it is the distance to the grid plus the value at its border: never less
        than the true distance, up to the rounding to cells, and still pulling back inside.

        Args:
            positions: (M, 3) metres.

        Returns:
            (M,) metres, differentiable.
        """
        inside = torch.minimum(torch.maximum(positions, self.low), self.high)
        unit = 2 * (inside - self.low) / (self.high - self.low) - 1  # [M, 3] in -1..1
        looked_up = functional.grid_sample(
            self.distances[None, None],
            unit.flip(1)[None, None, None],  # grid_sample wants the last axis first
            mode="bilinear",
            padding_mode="border",
            align_corners=True,
        ).view(-1)
        beyond: torch.Tensor = torch.linalg.vector_norm(positions - inside, dim=1)
        return looked_up + beyond
