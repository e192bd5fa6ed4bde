# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points that belong to a mover but not to its object: fragments, and cut-off bottoms."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.point_grid import PointGrid

# Points this close to a mover move with it. The search is limited to cells of this width.
_REACH_M: Final = 0.5
# A point this far above the lowest point of its cell is not ground.
_MIN_HEIGHT_M: Final = 0.1
# A fragment moves with a mover if more than this share of it is in reach.
_MIN_SHARE: Final = 0.5


def attached(
    current: ObjectSweep,
    owners: NDArray[np.int64],
    movers: ObjectPoints,
    is_loose: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns which points beside movers move with them.

    Args:
        current: The sweep.
        owners: (N,) the object of each point, see `ObjectSweep.objects`.
        movers: K objects that move.
        is_loose: (all objects of the sweep,) those that may be fragments: not known to be static.

    Returns:
        (M,) the points, none of the movers' own among them, and (M,) the row of the mover of each.
    """
    if len(movers) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    row_of = movers.rows_of(current.num_objects)
    is_own = row_of[current.thinned_objects] >= 0
    points, point_rows = current.thinned[is_own], row_of[current.thinned_objects[is_own]]
    candidates, num_loose = _points_near(points, current, owners, is_loose)
    nearest = PointGrid(points).nearest(np.take(current.xyz, candidates, axis=0), _REACH_M)
    is_close = nearest >= 0
    # A fragment moves as a whole, or not at all.
    close = np.bincount(owners[candidates[is_close]], minlength=current.num_objects)
    goes = close > _MIN_SHARE * num_loose
    goes[0] = True
    is_close &= goes[owners[candidates]]
    return candidates[is_close], point_rows[nearest[is_close]]


def _points_near(
    points: NDArray[np.float32],
    current: ObjectSweep,
    owners: NDArray[np.int64],
    is_loose: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the loose points, and those above the floor, in the cells beside points (P, 3).

    Then, (all objects,) how many points loose ones have altogether.
    """
    low = (points[:, :2].min(axis=0) - 2 * _REACH_M).astype(np.float32)
    size = ((points[:, :2].max(axis=0) - low) / _REACH_M).astype(np.int64) + 3
    return _near_cells(
        np.ascontiguousarray(points),
        low,
        np.zeros(size, np.uint8),
        np.ascontiguousarray(current.xyz),
        owners,
        current.kept,
        is_loose,
    )


@compiled(
    "UniTuple(int64[::1], 2)(float32[:, ::1], float32[::1], uint8[:, ::1], float32[:, ::1], "
    "int64[::1], boolean[::1], boolean[::1])"
)
def _near_cells(
    points: NDArray[np.float32],
    low: NDArray[np.float32],
    cells: NDArray[np.uint8],
    xyz: NDArray[np.float32],
    owners: NDArray[np.int64],
    kept: NDArray[np.bool_],
    is_loose: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Loop of `_points_near`; `low` is two cells before the points, the cells end behind."""
    reach, min_height = np.float32(_REACH_M), np.float32(_MIN_HEIGHT_M)
    for point in range(len(points)):
        column = int((points[point, 0] - low[0]) / reach)
        row = int((points[point, 1] - low[1]) / reach)
        cells[column - 1 : column + 2, row - 1 : row + 2] = 1
    # The cells at the border are not marked: all that is beyond them is in them.
    last_column, last_row = np.float32(cells.shape[0] - 1), np.float32(cells.shape[1] - 1)
    found = np.empty(len(xyz), np.int64)
    cell_of = np.empty(len(xyz), np.int64)
    floor = np.full(cells.size, np.float32(np.inf), np.float32)
    num_loose = np.zeros(len(is_loose), np.int64)
    number = 0
    for point in range(len(xyz)):
        if is_loose[owners[point]]:
            num_loose[owners[point]] += 1
        elif kept[point]:
            continue
        column = int(min(max((xyz[point, 0] - low[0]) / reach, np.float32(0)), last_column))
        row = int(min(max((xyz[point, 1] - low[1]) / reach, np.float32(0)), last_row))
        if not cells[column, row]:
            continue
        cell = column * cells.shape[1] + row
        if not kept[point]:
            floor[cell] = min(floor[cell], xyz[point, 2])
        found[number], cell_of[number] = point, cell
        number += 1
    num_wanted = 0
    for index in range(number):
        point = found[index]
        if kept[point] or xyz[point, 2] > floor[cell_of[index]] + min_height:
            found[num_wanted] = point
            num_wanted += 1
    return found[:num_wanted].copy(), num_loose
