# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Where the fits start: horizontal shifts that bring most points of a part onto other sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.methods.neural.parts import Parts
from mnsf_ros.objects.target import Target

_CELL_M: Final = 0.4
# Cells get larger where there would be more of them along a shift, or along a side of the grid.
_MAX_CELLS_OF_SHIFT: Final = 24
_MAX_CELLS_PER_AXIS: Final = 600
_MAX_LEVELS: Final = 40
# Every other point of a target is plenty for cells this large.
_STEP: Final = 2
# Of shifts with as many votes, the shorter is more likely: share of the votes per metre.
_COST_PER_M: Final = 0.02


def voted_shifts(
    parts: Parts, targets: Sequence[Target], max_motion_m: float, number: int
) -> list[NDArray[np.float32]]:
    """Returns (K, 3) metres each, the shifts to the next sweep with most votes, best first.

    A point votes for a shift if it meets an occupied cell of a target, by the steps of that.

    Args:
        parts: K parts.
        targets: The neighbouring sweeps.
        max_motion_m: Longest shift.
        number: Number of shifts for each part; none is beside an earlier one.
    """
    farthest_m = max_motion_m * max(abs(target.steps) for target in targets)
    low, high = parts.positions.min(axis=0), parts.positions.max(axis=0)
    margin = np.array([farthest_m, farthest_m, 0.0])
    low, high = low - margin, high + margin
    cell_m = max(
        _CELL_M,
        max_motion_m / _MAX_CELLS_OF_SHIFT,
        float((high - low)[:2].max()) / _MAX_CELLS_PER_AXIS,
        float((high - low)[2]) / _MAX_LEVELS,
    )
    # A cell more on each side, for what rounding does; above and below for the levels beside.
    low = low - 2 * cell_m
    shape = np.floor((high - low) / cell_m).astype(np.int64) + 3
    shifts = _shifts(int(max_motion_m / cell_m))
    votes = -_COST_PER_M * cell_m * np.hypot(*shifts.T)[None]
    own = _flat(np.floor((parts.positions - low) / cell_m).astype(np.int64), shape)
    for target in targets:
        occupied = _occupied(target, low, cell_m, shape)
        offsets = _flat(np.rint(shifts * target.steps).astype(np.int64), shape[:2]) * shape[2]
        hits = occupied[own[:, None] + offsets].view(np.int8)
        counts = np.add.reduceat(hits, parts.starts, axis=0, dtype=np.int32)
        votes = votes + counts / parts.counts[:, None]
    return [_metres(shifts[rows], cell_m) for rows in _best(votes, shifts, number)]


def _shifts(radius: int) -> NDArray[np.int64]:
    """(S, 2) whole shifts in a disc, in cells, the shortest first."""
    side = np.arange(-radius, radius + 1)
    shifts = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    squares = (shifts * shifts).sum(axis=1)
    order = np.argsort(squares, kind="stable")
    nearest: NDArray[np.int64] = shifts[order[squares[order] <= radius * radius]]
    return nearest


def _occupied(
    target: Target, low: NDArray[np.float64], cell_m: float, shape: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """(cells,) whether a target has a point in a cell, or right above or below."""
    points = transformed(target.sweep.thinned[::_STEP], target.to_current)
    cells = np.floor((points - low) / cell_m)
    cells = cells[((cells >= (0, 0, 1)) & (cells < shape - (0, 0, 1))).all(axis=1)].astype(np.int64)
    occupied = np.zeros(int(shape.prod()), np.bool_)
    flat = _flat(cells, shape)
    for level in (-1, 0, 1):
        occupied[flat + level] = True
    return occupied


def _flat(cells: NDArray[np.int64], shape: NDArray[np.int64]) -> NDArray[np.int64]:
    flat = cells[:, 0]
    for axis in range(1, len(shape)):
        flat = flat * shape[axis] + cells[:, axis]
    return flat


def _best(
    votes: NDArray[np.float64], shifts: NDArray[np.int64], number: int
) -> list[NDArray[np.int64]]:
    """(K,) rows of the best shifts, of votes (K, S)."""
    chosen = []
    for _ in range(number):
        best = votes.argmax(axis=1)
        chosen.append(best)
        is_beside = (np.abs(shifts - shifts[best][:, None]) <= 1).all(axis=2)
        votes = np.where(is_beside, -np.inf, votes)
    return chosen


def _metres(shifts: NDArray[np.int64], cell_m: float) -> NDArray[np.float32]:
    return np.pad(shifts * cell_m, ((0, 0), (0, 1))).astype(np.float32)
