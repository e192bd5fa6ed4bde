# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S): how far positions are from a target sweep, by a grid or by a search."""

from __future__ import annotations

import math

import torch
from scipy.spatial import cKDTree

from mnsf_ros.core.distance_transform import DistanceTransform, GridBox
from mnsf_ros.settings import DistanceSettings

_EXACT = "donot_use_mm_for_euclid_dist"

# Distances of a CUDA search that are in memory at once: 256 MiB of float32.
_MAX_PAIRS = 64 * 1024 * 1024


class TargetDistance:
    """Distance to a target sweep, differentiable in the positions."""

    def __init__(
        self,
        lookup: DistanceTransform | NearestNeighborDistance,
        truncation_m: float = 0.0,
        dead_zone_m: float = 0.0,
    ) -> None:
        self._lookup = lookup
        # None where nothing is limited.
        self._limits = (dead_zone_m or None, truncation_m or None)

    @classmethod
    def to_points(cls, points: torch.Tensor, settings: DistanceSettings) -> TargetDistance:
        """Builds the distance to a sweep as the settings ask.

        A grid that would be too large for memory, as one stray point far away makes it, is
        replaced by the tree, which costs the same for any extent.

        Args:
            points: (N, 3) float32, metres, the target sweep.
            settings: Kind, cell size, the largest grid allowed, the limits of the distances.
        """
        limits = settings.truncation_m, settings.dead_zone_m
        is_grid = settings.kind == "grid" or (settings.kind == "auto" and points.is_cuda)
        if is_grid:
            box = GridBox.around(points, settings.cell_size_m)
            if box.num_cells <= settings.max_cells:
                reach_m = settings.truncation_m or math.inf
                return cls(DistanceTransform.from_points(points, box, reach_m), *limits)
        return cls(NearestNeighborDistance(points), *limits)

    @property
    def kind(self) -> str:
        """`grid` or `tree`."""
        return self._lookup.kind

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres, in the target's frame, to (M,) metres."""
        distances = self._lookup(positions)
        return distances.clamp(*self._limits) if any(self._limits) else distances

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
        """Which target point is nearest: (M, 3) metres, without gradient, to (M,) rows."""
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
