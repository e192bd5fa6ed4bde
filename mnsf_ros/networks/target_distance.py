# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S): the distance of positions to a target sweep, by a distance transform or a search.

Section 2 of the paper, after FNSF. The distance transform is a grid, or bricks of one.
"""

import math
from contextlib import suppress
from typing import TypeAlias

import torch
from scipy.spatial import cKDTree

from mnsf_ros.networks.brick_distance import BrickDistance, BrickLimitError
from mnsf_ros.networks.cell_search import CellSearch
from mnsf_ros.networks.distance_transform import DistanceTransform, nodes_around
from mnsf_ros.settings import DistanceSettings

# Pairs of a CUDA search that are in memory at once: 512 MiB of float64.
_MAX_PAIRS = 64 * 1024 * 1024


class TargetDistance:
    """Distance to a target sweep, differentiable in the positions."""

    def __init__(self, points: torch.Tensor, settings: DistanceSettings) -> None:
        """Builds the distance to a sweep, (N, 3) float32 metres, of the kind in the settings.

        A grid that is too large, for example because of a stray point far away, is replaced by
        bricks if the distance is truncated, and these by the tree, which works for any extent.
        """
        self._lookup = _lookup_to(points, settings)
        self._truncation_m = settings.truncation_m

    @property
    def kind(self) -> str:
        """`grid`, `bricks`, `cells` or `tree`."""
        return self._lookup.kind

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres, in the target's frame, to (M,) metres."""
        distances = self._lookup(positions)
        return distances.clamp(max=self._truncation_m) if self._truncation_m else distances

    def with_gradient(self, positions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Distances of positions (M, 3), metres, and the gradient of each, (M, 3)."""
        if isinstance(self._lookup, CellSearch):
            # The search has a gradient of its own; what is truncated has none.
            return self._lookup.search(positions)
        own = positions.detach().requires_grad_()
        with torch.enable_grad():
            distances = self(own)
        (gradients,) = torch.autograd.grad(distances.sum(), own)
        return distances.detach(), gradients

    def mean(self, positions: torch.Tensor) -> torch.Tensor:
        """The loss of the paper: mean distance of the moved points to the sweep, metres."""
        return self(positions).mean()


def _lookup_to(points: torch.Tensor, settings: DistanceSettings) -> "Lookup":
    cell_size_m, reach_m = settings.cell_size_m, settings.truncation_m
    if settings.kind == "grid":
        _, shape = nodes_around(points, cell_size_m)
        if math.prod(shape) <= settings.max_cells:
            return DistanceTransform(points, cell_size_m)
    if settings.kind == "cells" and not points.is_cuda:
        return CellSearch(points, reach_m)
    if settings.kind != "tree" and reach_m:
        with suppress(BrickLimitError):
            return BrickDistance(points, cell_size_m, reach_m, settings.max_cells)
    return NearestNeighborDistance(points)


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
            # The tree refuses NaN and infinity; their distances are not finite with any neighbour.
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


Lookup: TypeAlias = DistanceTransform | BrickDistance | CellSearch | NearestNeighborDistance
