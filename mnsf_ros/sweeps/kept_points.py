# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The points of a sweep that fields are fitted to: inside the crop, and not ground.

Ground points are those close above a height map from which objects were removed.
"""

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.point_sets import bounds, chosen_points
from mnsf_ros.settings import CropSettings, GroundSettings, Settings
from mnsf_ros.sweeps.sweep import Sweep

_MIN_POINTS = 10
# A sweep whose points reach farther than this many cells in x or y is binned coarser.
_MAX_CELLS_PER_AXIS = 1024


def fit_mask(sweep: Sweep, settings: Settings) -> NDArray[np.bool_]:
    """Mask (N,) of the points that fields are fitted to: the kept ones, or those of the caller.

    Raises:
        SweepError: If too few points are left.
    """
    if sweep.kept is None:
        mask, choice = kept_mask(sweep.xyz, settings), " and ground removal"
    else:
        mask = sweep.kept & crop_mask(sweep.xyz, settings.crop)
        choice = ", ground removal and the choice of points"
    if (num_left := int(np.count_nonzero(mask))) < _MIN_POINTS:
        raise SweepError(
            f"sweep {sweep.stamp_ns}: {num_left} of {len(sweep)} points are left after crop"
            f"{choice}, expected at least {_MIN_POINTS}"
        )
    return mask


def kept_mask(xyz: NDArray[np.float32], settings: Settings) -> NDArray[np.bool_]:
    """Mask (N,) of the points (N, 3), sensor frame, inside the crop and above ground."""
    xyz = np.require(xyz, requirements=("C", "W"))
    kept = crop_mask(xyz, settings.crop)
    if settings.ground.remove:
        kept[kept] = ~ground_mask(chosen_points(xyz, kept), settings.ground)
    return kept


def crop_mask(xyz: NDArray[np.float32], settings: CropSettings) -> NDArray[np.bool_]:
    """Mask (N,) of the points (N, 3), sensor frame, within the ranges and heights."""
    return _inside(
        np.require(xyz, requirements=("C", "W")),
        settings.min_range_m**2,
        settings.max_range_m**2,
        np.float32(settings.min_height_m),
        np.float32(settings.max_height_m),
    )


@compiled("boolean[::1](float32[:, ::1], float64, float64, float32, float32)")
def _inside(
    xyz: NDArray[np.float32],
    least_squared: float,
    most_squared: float,
    min_height_m: np.float32,
    max_height_m: np.float32,
) -> NDArray[np.bool_]:
    inside = np.empty(len(xyz), np.bool_)
    # Of a flat array the compiler knows the steps: it looks at several points at once.
    values = xyz.reshape(-1)
    for row in range(len(xyz)):
        # float64: the square of a float32 coordinate of 1e20 is no float32.
        x, y = np.float64(values[3 * row]), np.float64(values[3 * row + 1])
        z, squared = values[3 * row + 2], x * x + y * y
        is_near = (least_squared <= squared) & (squared <= most_squared)
        inside[row] = is_near & (min_height_m <= z) & (z <= max_height_m)
    return inside


def ground_mask(xyz: NDArray[np.float32], settings: GroundSettings) -> NDArray[np.bool_]:
    """Mask (N,) of the ground points among (N, 3), sensor frame with z up.

    The lowest point of each cell makes a height map, without single cells far below their
    neighbours. A morphological opening removes everything narrower than the window (cars, people,
    poles, walls); points within the margin above the remaining heights are ground.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    points = np.require(xyz, requirements=("C", "W"))
    low_x, low_y, high_x, high_y = map(float, bounds(points))
    extent = max(high_x - low_x, high_y - low_y)
    cell_size_m = max(settings.cell_size_m, extent / _MAX_CELLS_PER_AXIS)
    cells, lowest = _lowest_of_cells(points, low_x, low_y, high_x, high_y, cell_size_m)
    rise = settings.max_slope * cell_size_m
    lowest = _without_pits(lowest, rise, settings.margin_m)
    radius = max(1, round(settings.window_m / 2 / cell_size_m))
    # An opening. Its structuring element is a cone, not a disc: it may rise with the steepest slope
    # allowed, so that a hill stays ground while a car on it does not.
    ground = -cone_erosion(-cone_erosion(lowest, radius, rise), radius, rise)
    return _below(points, cells, ground.ravel() + np.float32(settings.margin_m))


@compiled(
    "Tuple((int32[::1], float32[:, ::1]))"
    "(float32[:, ::1], float64, float64, float64, float64, float64)"
)
def _lowest_of_cells(
    xyz: NDArray[np.float32],
    low_x: float,
    low_y: float,
    high_x: float,
    high_y: float,
    cell_size_m: float,
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """The cell of each point, and the lowest point of each cell (rows, columns)."""
    num_rows = int((high_x - low_x) / cell_size_m) + 1
    num_columns = int((high_y - low_y) / cell_size_m) + 1
    cells = np.empty(len(xyz), np.int32)
    # Of a flat array the compiler knows the steps: it looks at several points at once.
    values = xyz.reshape(-1)
    for point in range(len(xyz)):
        row = np.int32((np.float64(values[3 * point]) - low_x) / cell_size_m)
        column = np.int32((np.float64(values[3 * point + 1]) - low_y) / cell_size_m)
        cells[point] = row * np.int32(num_columns) + column
    lowest = np.full(num_rows * num_columns, np.float32(np.inf))
    for point in range(len(xyz)):
        lowest[cells[point]] = min(lowest[cells[point]], xyz[point, 2])
    return cells, lowest.reshape(num_rows, num_columns)


@compiled("boolean[::1](float32[:, ::1], int32[::1], float32[::1])")
def _below(
    xyz: NDArray[np.float32], cells: NDArray[np.int32], limits: NDArray[np.float32]
) -> NDArray[np.bool_]:
    below = np.empty(len(xyz), np.bool_)
    for point in range(len(xyz)):
        below[point] = xyz[point, 2] <= limits[cells[point]]
    return below


def _without_pits(lowest: NDArray[np.float32], rise: float, margin_m: float) -> NDArray[np.float32]:
    """Height map with single cells far below their neighbours lifted to these.

    A laser that is mirrored by a car measures a point below the ground. The opening would follow
    it down, and the road half a window around it would count as objects.
    """
    is_empty = np.isinf(lowest)
    # A closing; empty cells must not count in its dilation.
    dilated = -cone_erosion(np.where(is_empty, np.inf, -lowest).astype(np.float32), 1, rise)
    dilated[np.isinf(dilated)] = np.inf
    closed = cone_erosion(dilated, 1, rise)
    with np.errstate(invalid="ignore"):
        is_pit = ~is_empty & (closed - lowest > margin_m)
    return np.where(is_pit, closed, lowest)


@compiled("void(float32[::1], float32[::1], float32[::1], float32[::1], float32)")
def _lower(
    before: NDArray[np.float32],
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    lowered: NDArray[np.float32],
    rise: np.float32,
) -> None:
    """Heights lowered to their neighbours on either side plus a rise."""
    for place in range(len(lowered)):
        lowered[place] = min(before[place], min(left[place], right[place]) + rise)


@compiled("float32[:, ::1](float32[:, ::1], int64, float64)")
def cone_erosion(
    heights: NDArray[np.float32], radius: int, rise_per_cell: float
) -> NDArray[np.float32]:
    """Smallest of `height + rise * distance` within the radius, along columns, then along rows."""
    num_rows, num_columns = heights.shape
    # Row by row, with so many empty places around that no step reaches another row, or leads out.
    width = num_columns + radius
    eroded = np.full((num_rows + 2 * radius, width), np.float32(np.inf))
    eroded[radius : radius + num_rows, :num_columns] = heights
    before = eroded.copy()
    flat, flat_before = eroded.reshape(-1), before.reshape(-1)
    start, end = radius * width, (radius + num_rows) * width
    for places in (1, width):
        # Cones add up: one of radius a, then one of radius b, is one of a + b. From radius a a step
        # of up to a + 1 to either side leaves no gap, so that the radius doubles with each step.
        reached = 0
        while reached < radius:
            step = min(reached + 1, radius - reached)
            reached += step
            shift = step * places
            left, right = flat[start - shift : end - shift], flat[start + shift : end + shift]
            rise = np.float32(rise_per_cell * step)
            _lower(flat[start:end], left, right, flat_before[start:end], rise)
            flat, flat_before = flat_before, flat
    return flat.reshape(-1, width)[radius : radius + num_rows, :num_columns].copy()
