# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Parts of a sweep: the points that fields are fitted to, and their residuals in other sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.target import Target

# Distances to other sweeps are truncated here.
REACH_M: Final = 0.5
# Distance between neighbouring points of one surface: by noise and thinning, and by range.
_SPACING_M: Final = 0.02
_SPACING_PER_M: Final = 0.0035


@dataclass(frozen=True, eq=False)
class Parts:
    """Points of K parts of a sweep, ordered by part.

    Attributes:
        rows: (P,) the points, as rows of the thinned sweep.
        positions: (P, 3) float32, metres, frame of the sweep.
        owners: (P,) from 0 to K - 1, rising.
    """

    rows: NDArray[np.int64]
    positions: NDArray[np.float32]
    owners: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        thinned: NDArray[np.float32],
        numbers: NDArray[np.int64],
        min_points: int,
        max_points: int,
    ) -> Parts:
        """Samples the parts that have enough points.

        Args:
            thinned: (T, 3) metres.
            numbers: (T,) the part of each point; 0 for none.
            min_points: Smaller parts are left out.
            max_points: Points sampled of each part, evenly.
        """
        is_large = np.bincount(numbers, minlength=1) >= min_points
        is_large[0] = False
        rows = np.flatnonzero(is_large[numbers])
        rows = rows[np.argsort(numbers[rows], kind="stable")]
        _, owners = np.unique(numbers[rows], return_inverse=True)
        whole = cls(rows, np.take(thinned, rows, axis=0), owners.reshape(-1))
        return whole.thinner(max_points)

    def __len__(self) -> int:
        return int(self.owners[-1]) + 1 if len(self.owners) else 0

    def only(self, wanted: NDArray[np.bool_]) -> Parts:
        """Returns the parts of the (K,) mask."""
        chosen = wanted[self.owners]
        owners = (np.cumsum(wanted) - 1)[self.owners[chosen]]
        return Parts(self.rows[chosen], self.positions[chosen], owners)

    def thinner(self, max_points: int) -> Parts:
        """Returns the same parts with at most so many points each, evenly chosen."""
        ranks = np.arange(len(self.owners)) - self.starts[self.owners]
        counts = self.counts[self.owners]
        wanted = np.minimum(counts, max_points)
        chosen = ranks * wanted // counts != (ranks + 1) * wanted // counts
        return Parts(self.rows[chosen], self.positions[chosen], self.owners[chosen])

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(K,) number of points of each part."""
        return np.bincount(self.owners)

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """(K,) first point of each part."""
        starts: NDArray[np.int64] = np.cumsum(self.counts) - self.counts
        return starts

    @cached_property
    def extents(self) -> NDArray[np.float32]:
        """(K, 3) metres, sides of the box around each part."""
        if len(self) == 0:
            return np.zeros((0, 3), np.float32)
        high, low = (
            bound.reduceat(self.positions, self.starts) for bound in (np.maximum, np.minimum)
        )
        return np.asarray(high - low, np.float32)

    @cached_property
    def spacing(self) -> NDArray[np.float32]:
        """(P,) metres; a point of another sweep within it is not evidence of motion."""
        ranges = np.sqrt((self.positions * self.positions).sum(axis=1))
        return np.asarray(_SPACING_M + _SPACING_PER_M * ranges, np.float32)

    def means(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Returns (K,) or (K, C), the mean over each part's points of values (P,) or (P, C)."""
        if values.ndim == 1:
            sums = np.bincount(self.owners, values, len(self))
            return np.asarray(sums / self.counts, np.float64)
        return np.stack([self.means(column) for column in values.T], axis=1)

    def residuals(self, target: Target, motions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Returns (K,) metres, mean distance of the moved parts to the target beyond the spacing.

        Args:
            target: Another sweep.
            motions: (K, 3) metres to the next sweep.
        """
        sums, _, _ = self._compared(target, self.owners, target.steps * motions, self.spacing)
        return np.asarray(sums / self.counts, np.float64)

    def point_residuals(self, target: Target, flow: NDArray[np.float32]) -> NDArray[np.float64]:
        """Returns (P,) metres, the same of each point with the flow (P, 3) to the next sweep."""
        each = np.arange(len(self.rows))
        distances, _, _ = self._compared(target, each, target.steps * flow, self.spacing)
        return distances

    def pulls(
        self, target: Target, moved: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Returns offsets to the nearest points of the target, after a motion (P, 3) until then.

        Returns:
            (P, 3) metres, axes of the current frame; (P,) metres, their lengths; and (P,) whether
            there is a point in reach.
        """
        exactly = np.zeros_like(self.spacing)
        each = np.arange(len(self.rows))
        distances, vectors, counts = self._compared(target, each, moved, exactly)
        return vectors @ target.from_current[:3, :3], distances, counts > 0

    def _compared(
        self,
        target: Target,
        owners: NDArray[np.int64],
        motions: NDArray[np.floating],
        within_m: NDArray[np.float32],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        own = np.ascontiguousarray(motions, np.float32)
        grid = target.sweep.grid
        return grid.compared(self.positions, owners, own, target.from_current, within_m, REACH_M)


def best_of(
    parts: Parts,
    targets: list[Target],
    candidates: list[NDArray[np.float32]],
    cost_per_m: float = 0.0,
) -> NDArray[np.float32]:
    """Returns (K, 3) metres, for each part the motion that leaves the smallest residual.

    Args:
        parts: K parts.
        targets: Other sweeps, whose residuals count alike.
        candidates: (K, 3) metres each, motions to the next sweep; of equal ones the first.
        cost_per_m: Residual that a metre of motion must save.
    """
    costs = [
        sum(parts.residuals(target, motions) for target in targets) / len(targets)
        + cost_per_m * np.sqrt((motions * motions).sum(axis=1))
        for motions in candidates
    ]
    best: NDArray[np.float32] = np.stack(candidates)[
        np.argmin(costs, axis=0), np.arange(len(parts))
    ]
    return best
