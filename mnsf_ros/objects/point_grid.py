# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points of a sweep in cells: distance and direction from objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.nearest_points import (
    NUM_TARGETS,
    Objects,
    choose,
    compared,
    in_buckets,
    residuals_of,
    rows_of_nearest,
)


class PointGrid:
    """Points, sorted by the cells they are in.

    Attributes:
        starts: (B + 1,) where each bucket of cells begins, and where the last one ends.
        points: (T, 3) float32, metres, in the order of their buckets.
    """

    def __init__(self, points: NDArray[np.floating]) -> None:
        """Sorts points (T, 3), in metres."""
        own = np.ascontiguousarray(points, np.float32)
        self.starts, self.points, self._rows = in_buckets(own)

    def nearest(self, places: NDArray[np.floating], reach_m: float) -> NDArray[np.int64]:
        """Returns (P,) the row of the point nearest to each place, -1 where none is in reach.

        Args:
            places: (P, 3) metres.
            reach_m: At most `MAX_REACH_M`.
        """
        own = np.ascontiguousarray(places, np.float32)
        return rows_of_nearest(own, np.float32(reach_m), self.starts, self.points, self._rows)

    def compared(
        self,
        positions: NDArray[np.float32],
        owners: NDArray[np.int64],
        motions: NDArray[np.float32],
        transform: NDArray[np.float64],
        within_m: NDArray[np.float32],
        reach_m: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Compares the points of objects with those of the grid.

        Args:
            positions: (P, 3) metres, of K objects.
            owners: (P,) from 0 to K - 1, their objects.
            motions: (K, 3) metres, added to the positions.
            transform: (4, 4) from the frame of the positions to that of the grid.
            within_m: (P,) metres; a point of the grid that is nearer is as good as the nearest one.
            reach_m: Points farther off do not count, at most `MAX_REACH_M`.

        Returns:
            Sums over each object's points: (K,) distances beyond `within_m`, at most `reach_m`;
            (K, 3) vectors to points of the grid in reach, in its frame; (K,) how many have one.
        """
        return compared(
            positions,
            owners,
            np.ascontiguousarray(motions, np.float32),
            np.ascontiguousarray(transform[:3], np.float32),
            within_m,
            np.float32(reach_m),
            self.starts,
            self.points,
        )


class PointGrids:
    """The points of several sweeps, near ones first, that objects are compared with at once."""

    def __init__(
        self,
        grids: Sequence[PointGrid],
        transforms: Sequence[NDArray[np.float64]],
        num_near: int,
        reach_m: float,
    ) -> None:
        """Takes grids as they are.

        Args:
            grids: At least one, at most four.
            transforms: (4, 4) each, from the frame of the objects to that of the grid.
            num_near: The first so many are near in time; the others are from the past.
            reach_m: Points farther off do not count, at most `MAX_REACH_M`.
        """
        self._reach_m = np.float32(reach_m)
        own = [np.asarray(transform[:3], np.float32) for transform in transforms]
        padded = [*grids, *[grids[0]] * (NUM_TARGETS - len(grids))]
        starts = tuple(grid.starts for grid in padded)
        self._targets = np.stack(own), num_near, starts, tuple(grid.points for grid in padded)

    def residuals(
        self, objects: Objects, shifts: NDArray[np.float32], limits_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns (K, T) metres, how far K objects are from the points of each of T sweeps.

        That is the mean over the points of an object, beyond what is near enough, at most the
        reach.

        Args:
            objects: Their points.
            shifts: (T, 1, K, 3) metres, how far they have moved by the time of each sweep.
            limits_m: (K,) metres; where the mean of the near ones plus that of the others is above,
                the last ones are infinite.
        """
        return residuals_of(limits_m, self._reach_m, shifts, objects, self._targets)

    def choose(
        self,
        objects: Objects,
        motions: NDArray[np.float32],
        residuals: NDArray[np.float64],
        candidates: NDArray[np.float32],
        shifts: NDArray[np.float32],
        share: float,
        better_m: float,
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Returns the best motion (K, 3) of each object and its residuals (K, T).

        Args:
            objects: Their points.
            motions: (K, 3) metres, the best so far.
            residuals: (K, T) metres, of these motions.
            candidates: (C, K, 3) metres, motions that are tried one after the other.
            shifts: (T, C, K, 3) metres, how far the objects move by them until each sweep.
            share: A candidate must leave less than this share of what the best one leaves,
            better_m: and this much less.
        """
        motions, residuals = motions.copy(), residuals.copy()
        rules = share, better_m, self._reach_m
        choose(motions, residuals, candidates, *rules, shifts, objects, self._targets)
        return motions, residuals
