"""Cells around points, with room for shifts: which of them other sweeps occupy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.objects.target import Target

_CELL_M: Final = 0.4
# Beyond this many cells they get larger: memory stays bounded, whatever the crop.
_MAX_CELLS_PER_AXIS: Final = 1024
# Nor does the work grow with the square of the interval: a sensor that is slow has larger cells.
_MAX_CELLS_OF_MARGIN: Final = 64
# Heights around the middle of the points. One level below and above stays empty.
_NUM_LEVELS: Final = 16


class VotingGrid:
    """A grid in the current sweep's frame; cells are numbered through.

    Attributes:
        cell_m: Size of a cell.
    """

    def __init__(self, points: NDArray[np.float32], margin_m: float) -> None:
        """Lays a grid around points (N, 3), metres, and so far around them."""
        low = [float(points[:, axis].min()) - margin_m for axis in (0, 1)]
        high = [float(points[:, axis].max()) + margin_m for axis in (0, 1)]
        extents = [end - start for start, end in zip(low, high, strict=True)]
        self.cell_m = max(
            _CELL_M, max(extents) / _MAX_CELLS_PER_AXIS, margin_m / _MAX_CELLS_OF_MARGIN
        )
        middle_m = (float(points[:, 2].min()) + float(points[:, 2].max())) / 2
        bottom_m = middle_m - _NUM_LEVELS * self.cell_m / 2
        # Two cells more, for what rounding may do to a shift at the edge.
        self._low = np.array([*(start - self.cell_m for start in low), bottom_m], np.float32)
        rows, columns = (int(extent / self.cell_m) + 3 for extent in extents)
        self._shape = (rows, columns, _NUM_LEVELS)

    def steps(self, shifts: NDArray[np.int64]) -> NDArray[np.int64]:
        """(S,) what shifts (S, 2), in cells, add to the number of a cell."""
        return (shifts[:, 0] * self._shape[1] + shifts[:, 1]) * self._shape[2]

    def cells_of(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """(P,) the cells of points (P, 3); those above and below count to the last level."""
        cells = np.floor((points - self._low) / np.float32(self.cell_m)).astype(np.int64)
        levels: NDArray[np.int64] = np.clip(cells[:, 2], 0, _NUM_LEVELS - 1)
        return self.steps(cells[:, :2]) + levels

    def occupied(self, targets: Sequence[Target]) -> NDArray[np.bool_]:
        """(T, cells) whether targets have a point in a cell, or right above or below it."""
        occupied = np.zeros((len(targets), int(np.prod(self._shape))), dtype=bool)
        for target, row in zip(targets, occupied, strict=True):
            # Cells are three thinned points wide: every other point is plenty.
            _mark(row, target.points(step=2), self._low, np.float32(self.cell_m), *self._shape)
        return occupied


@compiled("void(boolean[::1], float32[:, ::1], float32[::1], float32, int64, int64, int64)")
def _mark(
    occupied: NDArray[np.bool_],
    points: NDArray[np.float32],
    low: NDArray[np.float32],
    cell_m: np.float32,
    num_rows: int,
    num_columns: int,
    num_levels: int,
) -> None:
    """Marks the cells of points that are inside, and those above and below."""
    for index in range(len(points)):
        row = np.floor((points[index, 0] - low[0]) / cell_m)
        column = np.floor((points[index, 1] - low[1]) / cell_m)
        level = np.floor((points[index, 2] - low[2]) / cell_m)
        if 0 <= row < num_rows and 0 <= column < num_columns and 1 <= level < num_levels - 1:
            cell = (int(row) * num_columns + int(column)) * num_levels + int(level)
            occupied[cell - 1 : cell + 2] = True
