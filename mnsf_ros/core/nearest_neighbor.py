"""Distance to the nearest point of a target sweep: exact, and small for any extent."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree

_EXACT = "donot_use_mm_for_euclid_dist"

# Distances of a CUDA search that are in memory at once: 256 MiB of float32.
_MAX_PAIRS = 64 * 1024 * 1024


class NearestNeighborDistance:
    """Distance to the nearest target point: a k-d tree on the CPU, brute force on CUDA."""

    kind = "tree"

    def __init__(self, points: torch.Tensor) -> None:
        self._points = points
        self._tree = None if points.is_cuda else cKDTree(points.nan_to_num().numpy())

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """Distance of positions to the sweep.

        Args:
            positions: (M, 3) metres.

        Returns:
            (M,) metres, differentiable: the gradient pulls toward the nearest point.
        """
        nearest = self._points[self.nearest_indices(positions.detach())]
        distances: torch.Tensor = torch.linalg.vector_norm(positions - nearest, dim=1)
        return distances

    def nearest_indices(self, positions: torch.Tensor) -> torch.Tensor:
        """Which target point is nearest: (M, 3) metres, without gradient, to (M,) rows."""
        if self._tree is not None:
            # The tree refuses NaN and infinity; any neighbor will do for a distance that is none.
            _, indices = self._tree.query(positions.nan_to_num().numpy())
            return torch.from_numpy(indices)
        chunk = max(1, _MAX_PAIRS // len(self._points))
        return torch.cat(
            [
                # By matrix products it is faster, but wrong for neighbors far from the origin.
                torch.cdist(part, self._points, compute_mode=_EXACT).argmin(dim=1)
                for part in positions.split(chunk)
            ]
        )
