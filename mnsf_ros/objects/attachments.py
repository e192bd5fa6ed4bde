# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points that belong to a mover but not to its object: fragments, and cut-off bottoms."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.point_grid import REACH_M, PointGrid
from mnsf_ros.sweeps.kept_points import cone_erosion

# A point this far above the road is not ground. Under a vehicle no road is seen: its height is that
# of the lowest point within this distance, plus what it may rise on the way (rise over run).
_MIN_HEIGHT_M: Final = 0.1
_ROAD_REACH_M: Final = 2.5
_SLOPE: Final = 0.2
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
    points, point_rows = movers.all_points(current)
    candidates, num_loose = _points_near(points, current, owners, is_loose)
    nearest = PointGrid(points).nearest(np.take(current.xyz, candidates, axis=0))
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
    """Returns the loose points, and those above the road, in the cells beside points (P, 3).

    Then, (all objects,) how many points loose ones have altogether.
    """
    margin_m = REACH_M + _ROAD_REACH_M
    low = (points[:, :2].min(axis=0) - margin_m).astype(np.float32)
    shape = ((points[:, :2].max(axis=0) + margin_m - low) / REACH_M).astype(np.int64) + 2
    xyz = np.ascontiguousarray(current.xyz)
    cells = _cells(xyz, low, *shape)
    lowest = _lowest(xyz, cells, current.kept, shape.prod()).reshape(shape)
    road = cone_erosion(lowest, round(_ROAD_REACH_M / REACH_M), _SLOPE * REACH_M)
    is_near = np.zeros(shape, np.bool_)
    columns, rows = ((points[:, :2] - low) / np.float32(REACH_M)).astype(np.int64).T
    for across in (-1, 0, 1):
        for along in (-1, 0, 1):
            is_near[columns + across, rows + along] = True
    return _in_cells(is_near.ravel(), road.ravel(), xyz, cells, owners, current.kept, is_loose)


@compiled("int32[::1](float32[:, ::1], float32[::1], int64, int64)")
def _cells(
    xyz: NDArray[np.float32], low: NDArray[np.float32], num_columns: int, num_rows: int
) -> NDArray[np.int32]:
    """Returns (N,) the cells of points (N, 3) in a grid from `low` on, -1 outside it."""
    reach = np.float32(REACH_M)
    cells = np.full(len(xyz), -1, np.int32)
    for point in range(len(xyz)):
        column, row = (xyz[point, 0] - low[0]) / reach, (xyz[point, 1] - low[1]) / reach
        if (column >= 0) & (column < num_columns) & (row >= 0) & (row < num_rows):
            cells[point] = int(column) * num_rows + int(row)
    return cells


@compiled("float32[::1](float32[:, ::1], int32[::1], boolean[::1], int64)")
def _lowest(
    xyz: NDArray[np.float32], cells: NDArray[np.int32], kept: NDArray[np.bool_], number: int
) -> NDArray[np.float32]:
    """Returns (number,) the height of the lowest point of each cell that was taken for ground."""
    lowest = np.full(number, np.float32(np.inf))
    for point in range(len(xyz)):
        cell = cells[point]
        if cell >= 0 and not kept[point]:
            lowest[cell] = min(lowest[cell], xyz[point, 2])
    return lowest


@compiled(
    "UniTuple(int64[::1], 2)(boolean[::1], float32[::1], float32[:, ::1], int32[::1], "
    "int64[::1], boolean[::1], boolean[::1])"
)
def _in_cells(
    is_near: NDArray[np.bool_],
    road: NDArray[np.float32],
    xyz: NDArray[np.float32],
    cells: NDArray[np.int32],
    owners: NDArray[np.int64],
    kept: NDArray[np.bool_],
    is_loose: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Loop of `_points_near`."""
    found = np.empty(len(xyz), np.int64)
    num_loose = np.zeros(len(is_loose), np.int64)
    number = 0
    for point in range(len(xyz)):
        if is_loose[owners[point]]:
            num_loose[owners[point]] += 1
        elif kept[point]:
            continue
        cell = cells[point]
        if cell < 0 or not is_near[cell]:
            continue
        if kept[point] or xyz[point, 2] > road[cell] + np.float32(_MIN_HEIGHT_M):
            found[number] = point
            number += 1
    return found[:number].copy(), num_loose
