# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S): the distance of positions to a target sweep, by a distance transform or a search.

Section 2 of the paper, after FNSF. The distance transform is a grid of distances, built once and
looked up everywhere, exact (Euclidean) at the grid nodes up to the rounding of points to nodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import edt
import numpy as np
import torch
from scipy.spatial import cKDTree
from torch.nn import functional

from mnsf_ros.core.compute_device import on_device
from mnsf_ros.settings import DistanceSettings

_PADDING_CELLS = 2
_EXACT = "donot_use_mm_for_euclid_dist"

# Distances of a CUDA search that are in memory at once: 256 MiB of float32.
_MAX_PAIRS = 64 * 1024 * 1024


class TargetDistance:
    """Distance to a target sweep, differentiable in the positions."""

    def __init__(
        self,
        lookup: DistanceTransform | NearestNeighborDistance,
        truncation_m: float = 0.0,
    ) -> None:
        self._lookup = lookup
        self._truncation_m = truncation_m

    @classmethod
    def to_points(cls, points: torch.Tensor, settings: DistanceSettings) -> TargetDistance:
        """Builds the distance to a sweep as the settings ask.

        A grid that would be too large for memory, as one stray point far away makes it, is
        replaced by the tree, which costs the same for any extent.

        Args:
            points: (N, 3) float32, metres, the target sweep.
            settings: Kind, cell size, the largest grid allowed, the truncation.
        """
        if settings.kind == "grid":
            box = GridBox.around(points, settings.cell_size_m)
            if box.num_cells <= settings.max_cells:
                return cls(DistanceTransform.from_points(points, box), settings.truncation_m)
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
        distances: torch.Tensor = torch.linalg.vector_norm(positions - nearest, dim=1)
        return distances

    def nearest_indices(self, positions: torch.Tensor) -> torch.Tensor:
        """Row of the nearest target point: (M, 3) metres, without gradient, to (M,)."""
        if self._tree is not None:
            # The tree refuses NaN and infinity; any neighbour will do for a distance that is none.
            _, indices = self._tree.query(positions.nan_to_num().numpy())
            return torch.from_numpy(indices)
        chunk = max(1, _MAX_PAIRS // len(self._points))
        return torch.cat(
            [
                # By matrix products it is faster, but wrong for neighbours far from the origin.
                torch.cdist(part, self._points, compute_mode=_EXACT).argmin(dim=1)
                for part in positions.split(chunk)
            ]
        )


@dataclass(frozen=True)
class GridBox:
    """Extent and resolution of a grid.

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
    """Distances to a sweep on a grid, interpolated trilinearly between the nodes.

    Attributes:
        distances: (nx, ny, nz) float32, metres, those of the nodes.
    """

    kind = "grid"

    def __init__(self, distances: torch.Tensor, box: GridBox) -> None:
        self.distances = distances
        self._low = distances.new_tensor(box.origin)
        steps = distances.new_tensor(box.shape) - 1
        self._high = self._low + steps * box.cell_size_m

    @classmethod
    def from_points(cls, points: torch.Tensor, box: GridBox) -> DistanceTransform:
        """Builds the transform with torch's threads.

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
        return cls(on_device(distances, points.device), box)

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """Distance of positions to the sweep.

        Outside the grid it is the distance to the grid plus the value at its border: never less
        than the true distance, up to the rounding to cells, and still pulling back inside.

        Args:
            positions: (M, 3) metres.

        Returns:
            (M,) metres, differentiable.
        """
        inside = torch.minimum(torch.maximum(positions, self._low), self._high)
        unit = 2 * (inside - self._low) / (self._high - self._low) - 1  # [M, 3] in -1..1
        looked_up = functional.grid_sample(
            self.distances[None, None],
            unit.flip(1)[None, None, None],  # grid_sample wants the last axis first
            mode="bilinear",
            padding_mode="border",
            align_corners=True,
        ).view(-1)
        beyond: torch.Tensor = torch.linalg.vector_norm(positions - inside, dim=1)
        return looked_up + beyond
