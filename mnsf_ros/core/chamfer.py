"""NSFP's loss: squared distances to the nearest neighbor, in both directions."""

from __future__ import annotations

import torch

from mnsf_ros.core.nearest_neighbor import NearestNeighborDistance


class ChamferDistance:
    """Chamfer distance of moved points to a target sweep (section 2 of the paper, after NSFP).

    The mean over the moved points of the squared distance to the nearest target point, plus the
    mean over the target points of that to the nearest moved point. Pairs that are too far apart
    count as zero, but still as one of those whose mean is taken.
    """

    def __init__(self, points: torch.Tensor, truncation_m: float) -> None:
        """Prepares the search among the target points, (N, 3) metres."""
        self._points = points
        self._target = NearestNeighborDistance(points)
        self._largest = truncation_m**2

    def __call__(self, moved: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres to a scalar in square metres, differentiable."""
        # One moved point may be the nearest of many: the gradient pulls it to all of them.
        nearest_moved = moved[NearestNeighborDistance(moved.detach()).nearest_indices(self._points)]
        nearest_target = self._points[self._target.nearest_indices(moved.detach())]
        return self._mean(moved - nearest_target) + self._mean(self._points - nearest_moved)

    def _mean(self, differences: torch.Tensor) -> torch.Tensor:
        squared = differences.square().sum(dim=1)
        return torch.where(squared > self._largest, 0.0, squared).mean()
