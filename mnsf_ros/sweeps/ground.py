"""Which points are ground: those close above a height map from which objects were removed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.settings import GroundSettings

# A sweep whose points reach farther than this many cells in x or y is binned coarser.
_MAX_CELLS_PER_AXIS = 1024


def ground_mask(xyz: NDArray[np.float32], settings: GroundSettings) -> NDArray[np.bool_]:
    """Says which of the points (N, 3), sensor frame with z up, are ground.

    The lowest point of each cell makes a height map, in which single cells that lie far below
    those around them do not count. A morphological opening takes from it all
    that is narrower than the window (cars, people, poles, walls); what is left is the ground,
    and a point within the margin above it is ground.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    cells, cell_size_m = _cells_of(xyz, settings.cell_size_m)
    shape = cells[:, 0].max() + 1, cells[:, 1].max() + 1
    flat_cells = cells[:, 0] * shape[1] + cells[:, 1]
    lowest = np.full(shape[0] * shape[1], np.inf, dtype=np.float32)
    np.minimum.at(lowest, flat_cells, xyz[:, 2])
    rise = settings.max_slope * cell_size_m
    lowest = _without_pits(lowest.reshape(shape), rise, settings.margin_m)
    radius = max(1, round(settings.window_m / 2 / cell_size_m))
    # An opening. Its structuring element is a cone, not a disc: it may rise with the steepest slope
    # allowed, so that a hill stays ground while a car on it does not.
    ground = -_cone_erosion(-_cone_erosion(lowest, radius, rise), radius, rise)
    mask: NDArray[np.bool_] = xyz[:, 2] <= ground.ravel()[flat_cells] + settings.margin_m
    return mask


def _cells_of(xyz: NDArray[np.float32], cell_size_m: float) -> tuple[NDArray[np.int64], float]:
    """Row and column of each point's cell (N, 2), and the size of the cells."""
    columns = [xyz[:, axis].astype(np.float64) for axis in (0, 1)]
    lows = [column.min() for column in columns]
    extent = max(column.max() - low for column, low in zip(columns, lows, strict=True))
    cell_size_m = max(cell_size_m, float(extent) / _MAX_CELLS_PER_AXIS)
    cells = np.empty((len(xyz), 2), np.int64)
    for axis, (column, low) in enumerate(zip(columns, lows, strict=True)):
        cells[:, axis] = (column - low) / cell_size_m
    return cells, cell_size_m


def _without_pits(lowest: NDArray[np.float32], rise: float, margin_m: float) -> NDArray[np.float32]:
    """Height map with single cells that are far below those around them lifted to these.

    A laser that is mirrored by a car measures a point below the ground. The opening would follow
    it down, and the road half a window around it would count as objects.
    """
    is_empty = np.isinf(lowest)
    # A closing; empty cells must not count in its dilation.
    dilated = -_cone_erosion(np.where(is_empty, np.inf, -lowest).astype(np.float32), 1, rise)
    dilated[np.isinf(dilated)] = np.inf
    closed = _cone_erosion(dilated, 1, rise)
    with np.errstate(invalid="ignore"):
        is_pit = ~is_empty & (closed - lowest > margin_m)
    return np.where(is_pit, closed, lowest)


def _cone_erosion(
    heights: NDArray[np.float32], radius: int, rise_per_cell: float
) -> NDArray[np.float32]:
    """Smallest of `height + rise * distance` within the radius, along rows, then columns."""
    along_rows = _cone_erosion_of_rows(heights.T, radius, rise_per_cell)
    return _cone_erosion_of_rows(along_rows.T, radius, rise_per_cell)


def _cone_erosion_of_rows(
    heights: NDArray[np.float32], radius: int, rise_per_cell: float
) -> NDArray[np.float32]:
    # Cones add up: one of radius a, then one of radius b, is one of a + b. From radius a a step
    # of up to a + 1 to either side leaves no gap, so that the radius doubles with each step.
    eroded = np.ascontiguousarray(heights)
    reached = 0
    while reached < radius:
        step = min(reached + 1, radius - reached, eroded.shape[0])
        rise = np.float32(rise_per_cell * step)
        lifted = eroded + rise
        eroded = eroded.copy()
        np.minimum(eroded[step:], lifted[:-step], out=eroded[step:])
        np.minimum(eroded[:-step], lifted[step:], out=eroded[:-step])
        reached += step
    return eroded
