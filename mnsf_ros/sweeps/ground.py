"""Which points are ground: those close above a height map from which objects were removed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mnsf_ros.settings import GroundSettings

# A sweep whose points reach farther than this many cells in x or y is binned coarser.
_MAX_CELLS_PER_AXIS = 1024


def ground_mask(xyz: NDArray[np.float32], settings: GroundSettings) -> NDArray[np.bool_]:
    """Says which points are ground.

    The lowest point of each cell makes a height map. A morphological opening takes from it all
    that is narrower than the window (cars, people, poles, walls); what is left is the ground,
    and a point within the margin above it is ground.

    Args:
        xyz: (N, 3) metres, sensor frame with z up.
        settings: Cell, window, slope and margin.

    Returns:
        (N,) bool.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    cells, cell_size_m = _cells_of(xyz, settings.cell_size_m)
    shape = cells[:, 0].max() + 1, cells[:, 1].max() + 1
    flat_cells = cells[:, 0] * shape[1] + cells[:, 1]
    lowest = _lowest_per_cell(flat_cells, xyz[:, 2], shape)
    ground = _opened(lowest, settings, cell_size_m)
    mask: NDArray[np.bool_] = xyz[:, 2] <= ground.ravel()[flat_cells] + settings.margin_m
    return mask


def _cells_of(xyz: NDArray[np.float32], cell_size_m: float) -> tuple[NDArray[np.int64], float]:
    xy = xyz[:, :2].astype(np.float64)
    low = xy.min(axis=0)
    extent = float((xy.max(axis=0) - low).max())
    cell_size_m = max(cell_size_m, extent / _MAX_CELLS_PER_AXIS)
    return ((xy - low) / cell_size_m).astype(np.int64), cell_size_m


def _lowest_per_cell(
    flat_cells: NDArray[np.int64], heights: NDArray[np.float32], shape: tuple[int, int]
) -> NDArray[np.float32]:
    lowest = np.full(shape[0] * shape[1], np.inf, dtype=np.float32)
    np.minimum.at(lowest, flat_cells, heights)
    return lowest.reshape(shape)


def _opened(
    lowest: NDArray[np.float32], settings: GroundSettings, cell_size_m: float
) -> NDArray[np.float32]:
    """Height map without what is narrower than the window. Empty cells are +inf on entry.

    The structuring element is a cone, not a disc: it may rise with the steepest slope allowed,
    so that a hill stays ground while a car on it does not.
    """
    radius = max(1, round(settings.window_m / 2 / cell_size_m))
    eroded = _cone_erosion(lowest, radius, settings.max_slope * cell_size_m)
    return -_cone_erosion(-eroded, radius, settings.max_slope * cell_size_m)


def _cone_erosion(
    heights: NDArray[np.float32], radius: int, rise_per_cell: float
) -> NDArray[np.float32]:
    """Smallest of `height + rise * distance` within the radius, along rows, then columns."""
    offsets = np.abs(np.arange(-radius, radius + 1, dtype=np.float32)) * rise_per_cell
    # grey_erosion subtracts the structure; -inf heights (empty, negated) stay what they are.
    for axis in (0, 1):
        structure = -offsets.reshape((-1, 1) if axis == 0 else (1, -1))
        heights = ndimage.grey_erosion(
            heights, footprint=np.ones(structure.shape, bool), structure=structure, mode="nearest"
        )
    return heights
