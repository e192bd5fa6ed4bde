# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of sampled points spread over all points that move with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.methods.neural.parts import REACH_M, Parts
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.point_grid import PointGrid
from mnsf_ros.objects.target import Target

# A point takes the flow of a sampled point of its part, or of a moving neighbour, in this reach.
_SPREAD_M = 0.6
# What was taken for ground moves with a point this near.
_GROUND_M = 0.3
# A neighbour moves along if that leaves less than this share of its residual, and this much less.
_MAX_LEFT = 0.9
_MIN_GAIN_M = 0.002
_NUM_ROUNDS = 2


class MovingPoints:
    """The thinned points of a sweep that move, and their flow.

    Attributes:
        flow: (T, 3) float32, metres to the next sweep; 0 for static points.
        is_moving: (T,) bool.
    """

    def __init__(
        self,
        current: ObjectSweep,
        numbers: NDArray[np.int64],
        movers: Parts,
        flow: NDArray[np.float32],
    ) -> None:
        """Spreads a flow over whole parts.

        Args:
            current: The sweep.
            numbers: (T,) the part of each of its thinned points.
            movers: The parts that move, at least one.
            flow: (P, 3) metres, of their points.
        """
        self._current = current
        self.flow = np.zeros_like(current.thinned)
        self.is_moving = np.zeros(len(current.thinned), np.bool_)
        are_movers = np.zeros(int(numbers.max()) + 1, np.bool_)
        are_movers[numbers[movers.rows]] = True
        self._take(np.flatnonzero(are_movers[numbers]), movers.positions, flow)

    def _take(
        self, rows: NDArray[np.int64], positions: NDArray[np.float32], flow: NDArray[np.float32]
    ) -> None:
        """Gives some points the flow of the nearest of the positions."""
        places = np.take(self._current.thinned, rows, axis=0)
        nearest = PointGrid(positions).nearest(places, _SPREAD_M)
        rows, nearest = rows[nearest >= 0], nearest[nearest >= 0]
        self.flow[rows], self.is_moving[rows] = flow[nearest], True

    def attach(self, targets: Sequence[Target], min_size_m: float) -> None:
        """Lets neighbouring objects move along that the flow explains better than none.

        Args:
            targets: The other sweeps.
            min_size_m: Objects of this size and longer do not move along.
        """
        for _ in range(_NUM_ROUNDS):
            beside = self._beside(self._current.sizes < min_size_m)
            if len(beside) == 0:
                return
            objects, motions = self._motions_beside(beside)
            numbers = np.zeros(self._current.num_objects, np.int64)
            numbers[objects] = np.arange(1, len(objects) + 1)
            own = np.where(self.is_moving, 0, numbers[self._current.thinned_objects])
            parts = Parts.of(self._current.thinned, own, min_points=1, max_points=len(own))
            static_m, moving_m = (
                np.mean([parts.residuals(target, each) for target in targets], axis=0)
                for each in (np.zeros_like(motions), motions)
            )
            moves = moving_m < _MAX_LEFT * static_m - _MIN_GAIN_M
            if not moves.any():
                return
            chosen = moves[parts.owners]
            rows = parts.rows[chosen]
            self.flow[rows], self.is_moving[rows] = motions[parts.owners[chosen]], True

    def _beside(self, may_move: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Static thinned points of objects (all objects,) that may move, around moving points."""
        points, objects = self._current.thinned, self._current.thinned_objects
        rows = np.flatnonzero(~self.is_moving & may_move[objects] & (objects > 0))
        return rows[self._is_around(points[rows])]

    def _is_around(self, xyz: NDArray[np.float32]) -> NDArray[np.bool_]:
        moving = self._current.thinned[self.is_moving]
        low, high = moving.min(axis=0) - _SPREAD_M, moving.max(axis=0) + _SPREAD_M
        is_around: NDArray[np.bool_] = ((xyz > low) & (xyz < high)).all(axis=1)
        return is_around

    def _motions_beside(
        self, rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """The objects of points that have a moving neighbour, and the mean flow of those."""
        moving = np.flatnonzero(self.is_moving)
        grid = PointGrid(np.take(self._current.thinned, moving, axis=0))
        nearest = grid.nearest(np.take(self._current.thinned, rows, axis=0), _SPREAD_M)
        flow = self.flow[moving[nearest[nearest >= 0]]]
        own = self._current.thinned_objects[rows[nearest >= 0]]
        objects, owners = np.unique(own, return_inverse=True)
        sums = [np.bincount(owners.reshape(-1), column, len(objects)) for column in flow.T]
        motions = np.stack(sums, axis=1) / np.bincount(owners.reshape(-1), minlength=1)[:, None]
        return objects, motions.astype(np.float32)

    def of_all(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Returns the flow of all points of the sweep (N, 3), and which of them move (N,)."""
        current = self._current
        motion = np.zeros((len(current.sweep), 3), np.float32)
        is_moving = np.zeros(len(motion), np.bool_)
        have_movers = np.zeros(current.num_objects, np.bool_)
        have_movers[current.thinned_objects[self.is_moving]] = True
        have_movers[0] = False
        rows = np.flatnonzero(have_movers[current.objects()])
        self._copy(motion, is_moving, rows, current.grid, np.arange(len(self.flow)), REACH_M)
        moving = np.flatnonzero(self.is_moving)
        ground = np.flatnonzero(~current.kept)
        ground = ground[self._is_around(np.take(current.xyz, ground, axis=0))]
        grid = PointGrid(np.take(current.thinned, moving, axis=0))
        self._copy(motion, is_moving, ground, grid, moving, _GROUND_M)
        return motion, is_moving

    def _copy(
        self,
        motion: NDArray[np.float32],
        is_moving: NDArray[np.bool_],
        rows: NDArray[np.int64],
        grid: PointGrid,
        thinned_rows: NDArray[np.int64],
        reach_m: float,
    ) -> None:
        """Gives points the flow of the nearest point of a grid, whose thinned rows are given."""
        nearest = grid.nearest(np.take(self._current.xyz, rows, axis=0), reach_m)
        rows, from_rows = rows[nearest >= 0], thinned_rows[nearest[nearest >= 0]]
        motion[rows], is_moving[rows] = self.flow[from_rows], self.is_moving[from_rows]
