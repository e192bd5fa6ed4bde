"""Points that belong to a mover but not to its object: fragments, and cut-off bottoms."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep

# Points this close to a mover move with it. The search is limited to cells of this width.
_REACH_M: Final = 0.5
# A point this far above the lowest point of its cell is not ground.
_MIN_HEIGHT_M: Final = 0.1
# A fragment moves with a mover if more than this share of it is in reach.
_MIN_SHARE: Final = 0.5
_TOUCHING: Final = np.ones((3, 3), dtype=bool)


def attached(
    current: ObjectSweep,
    owners: NDArray[np.int64],
    movers: ObjectPoints,
    is_loose: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Returns with which mover the points beside movers move.

    Args:
        current: The sweep.
        owners: (N,) the object of each point, see `ObjectSweep.objects`.
        movers: K objects that move.
        is_loose: (all objects of the sweep,) those that may be fragments: not known to be static.

    Returns:
        (N,) the row of the mover, -1 for points without one and for the movers' own points.
    """
    rows = np.full(len(owners), -1)
    if len(movers) == 0:
        return rows
    row_of = movers.rows_of(current.num_objects)
    is_own = row_of[current.thinned_objects] >= 0
    points, point_rows = current.thinned[is_own], row_of[current.thinned_objects[is_own]]
    xyz = current.xyz
    candidates = np.flatnonzero(is_loose[owners] | ~current.kept)
    cells, is_near = _cells_near(points, xyz[candidates])
    candidates, cells = candidates[is_near], cells[is_near]
    is_ground = ~current.kept[candidates]
    is_wanted = ~is_ground | _is_above_floor(xyz[candidates, 2], cells, is_ground)
    candidates = candidates[is_wanted]
    distances, nearest = cKDTree(points).query(xyz[candidates], distance_upper_bound=_REACH_M)
    is_close = np.isfinite(distances)
    # A fragment moves as a whole, or not at all.
    total = np.bincount(owners, minlength=current.num_objects)
    close = np.bincount(owners[candidates[is_close]], minlength=current.num_objects)
    goes = close > _MIN_SHARE * total
    goes[0] = True
    is_close &= goes[owners[candidates]]
    rows[candidates[is_close]] = point_rows[nearest[is_close]]
    return rows


def _cells_near(
    points: NDArray[np.float32], others: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Returns the cell in the view from above of others (N, 3), and if points (P, 3) are beside."""
    low = points[:, :2].min(axis=0) - 2 * _REACH_M
    size = ((points[:, :2].max(axis=0) - low) / _REACH_M).astype(np.int64) + 3
    occupied = np.zeros(size, dtype=bool)
    occupied[tuple(((points[:, :2] - low) / np.float32(_REACH_M)).astype(np.int64).T)] = True
    occupied = ndimage.binary_dilation(occupied, _TOUCHING)
    # All other points go to the cells at the border, which are empty.
    with np.errstate(over="ignore"):  # overflow to infinity is far away, too
        columns = [
            np.clip((others[:, axis] - low[axis]) / np.float32(_REACH_M), 0, size[axis] - 1)
            for axis in (0, 1)
        ]
    cells: NDArray[np.int64] = np.ravel_multi_index(
        tuple(column.astype(np.int64) for column in columns), tuple(size)
    )
    return cells, occupied.ravel()[cells]


def _is_above_floor(
    heights: NDArray[np.float32], cells: NDArray[np.int64], is_ground: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Returns (N,) whether points are clearly above the lowest ground point of their cell."""
    floor = np.full(int(cells.max(initial=0)) + 1, np.inf, np.float32)
    np.minimum.at(floor, cells[is_ground], heights[is_ground])
    is_above: NDArray[np.bool_] = heights > floor[cells] + np.float32(_MIN_HEIGHT_M)
    return is_above
