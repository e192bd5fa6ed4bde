"""D(p, S): how far positions are from a target sweep."""

from __future__ import annotations

from typing import Protocol

import torch

from mnsf_ros.core.distance_transform import DistanceTransform, GridBox
from mnsf_ros.core.nearest_neighbor import NearestNeighborDistance
from mnsf_ros.settings import DistanceSettings


class DistanceLookup(Protocol):
    """One way to compute the distance to a sweep."""

    kind: str

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres, in the target's frame, to (M,) metres, differentiable."""
        ...


class TargetDistance:
    """Distance to a target sweep, differentiable in the positions."""

    def __init__(self, lookup: DistanceLookup, truncation_m: float) -> None:
        self._lookup = lookup
        self._truncation_m = truncation_m

    @classmethod
    def to_points(cls, points: torch.Tensor, settings: DistanceSettings) -> TargetDistance:
        """Builds the distance to a sweep as the settings ask.

        A grid that would be too large for memory, as one stray point far away makes it, is
        replaced by the tree, which costs the same for any extent.

        Args:
            points: (N, 3) float32, metres, the target sweep.
            settings: Kind, cell size, the largest grid allowed, truncation.
        """
        if settings.kind == "grid":
            box = GridBox.around(points, settings.cell_size_m)
            if box.num_cells <= settings.max_cells:
                grid = DistanceTransform.from_points(points, box)
                return cls(grid, settings.truncation_m)
        return cls(NearestNeighborDistance(points), settings.truncation_m)

    @property
    def kind(self) -> str:
        """`grid` or `tree`."""
        return self._lookup.kind

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres, in the target's frame, to (M,) metres."""
        distances = self._lookup(positions)
        return distances.clamp(max=self._truncation_m) if self._truncation_m > 0 else distances

    def mean(self, positions: torch.Tensor) -> torch.Tensor:
        """The loss of the paper: mean distance of the moved points to the sweep, metres."""
        return self(positions).mean()
