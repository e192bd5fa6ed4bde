# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
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
# Heights around the middle of the points, a bit each. The lowest and the highest stay empty.
_NUM_LEVELS: Final = 16
# Cells are three thinned points wide: every other point is plenty.
_STEP: Final = 2


class VotingGrid:
    """A grid in the current sweep's frame; columns of cells are numbered through.

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
        self._shape = (rows, columns)

    def steps(self, shifts: NDArray[np.int64]) -> NDArray[np.int64]:
        """(S,) offsets in column numbers of shifts (S, 2), in cells."""
        return shifts[:, 0] * self._shape[1] + shifts[:, 1]

    def cells_of(self, points: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(P,) the columns of points (P, 3), and the bits of their levels.

        What is above or below counts to the last level.
        """
        cells = np.floor((points - self._low) / np.float32(self.cell_m)).astype(np.int64)
        return self.steps(cells[:, :2]), 1 << np.clip(cells[:, 2], 0, _NUM_LEVELS - 1)

    def occupied(self, targets: Sequence[Target]) -> NDArray[np.uint16]:
        """(T, columns) bits of the levels where targets have a point, right above or below."""
        occupied = np.zeros((len(targets), int(np.prod(self._shape))), np.uint16)
        cell_m = np.float32(self.cell_m)
        for target, columns in zip(targets, occupied, strict=True):
            transform = target.to_current[:3].astype(np.float32)
            _mark(columns, target.sweep.thinned, transform, self._low, cell_m, *self._shape)
        return occupied


@compiled(
    "void(uint16[::1], float32[:, ::1], float32[:, ::1], float32[::1], float32, int64, int64)"
)
def _mark(
    occupied: NDArray[np.uint16],
    points: NDArray[np.float32],
    transform: NDArray[np.float32],
    low: NDArray[np.float32],
    cell_m: np.float32,
    num_rows: int,
    num_columns: int,
) -> None:
    """Marks the cells of transformed points that are inside, and those above and below."""
    cell = np.zeros(3, np.float32)
    for index in range(0, len(points), _STEP):
        x, y, z = points[index, 0], points[index, 1], points[index, 2]
        for axis in range(3):
            turned = x * transform[axis, 0] + y * transform[axis, 1] + z * transform[axis, 2]
            cell[axis] = np.floor((turned + transform[axis, 3] - low[axis]) / cell_m)
        is_inside = 0 <= cell[0] < num_rows and 0 <= cell[1] < num_columns
        if is_inside and 1 <= cell[2] < _NUM_LEVELS - 1:
            column = int(cell[0]) * num_columns + int(cell[1])
            occupied[column] |= np.uint16(7 << (int(cell[2]) - 1))
