# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The ground: a plane at each place, fitted to the lowest points around it, from coarse to fine."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Floats32
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.point_sets import MAX_CELLS_PER_AXIS, bounds
from mnsf_ros.settings import GroundSettings

# So many cells of an axis share a plane.
_BLOCK: Final = 4
# From the first level to the last one window and tolerance are halved with each.
_NUM_LEVELS: Final = 5


class GroundSurface:
    """The ground under a sweep.

    The lowest point of each cell is ground, or something that stands on it. Planes are fitted to
    all of them at first, then to smaller and smaller windows, each time to those that are close to
    the planes before; what is above counts less than what is below. So the road is known under a
    car, between the rings of few beams and on a slope, and a laser that a wet road mirrors is one
    point of many.
    """

    def __init__(self, xyz: Floats32, settings: GroundSettings) -> None:
        """Fits the ground to a sweep.

        Args:
            xyz: (N, 3) metres, z up; finite.
            settings: Cells, window and margin.
        """
        self._low, self._cell_size_m = (0.0, 0.0), settings.cell_size_m
        self._planes: Floats = np.zeros((1, 1, 3))
        if len(xyz) == 0:
            return
        points = np.require(xyz, requirements=("C", "W"))
        low_x, low_y, high_x, high_y = map(float, bounds(points))
        extent = max(high_x - low_x, high_y - low_y)
        self._low = low_x, low_y
        self._cell_size_m = cell_size_m = max(settings.cell_size_m, extent / MAX_CELLS_PER_AXIS)
        lowest = _lowest(points, low_x, low_y, high_x, high_y, cell_size_m)
        num_rows, num_columns = (-(-size // _BLOCK) for size in lowest.shape)
        self._planes = np.zeros((num_rows, num_columns, 3))
        self._planes[..., 0] = np.median(lowest[np.isfinite(lowest)])
        for level in reversed(range(_NUM_LEVELS)):
            reach = max(1, round(settings.window_m * 2**level / 2 / (_BLOCK * cell_size_m)))
            self._planes = _fitted(lowest, self._planes, reach, settings.margin_m * 2**level)

    def heights(self, xyz: Floats32) -> Floats32:
        """(N,) metres, how far points (N, 3) are above the ground, or below it if negative."""
        points = np.require(xyz, requirements=("C", "W"))
        return _heights(points, *self._low, self._cell_size_m, self._planes)

    def slopes(self, xyz: Floats32) -> Floats32:
        """(N, 2) rise over run of the ground along x and y, at points (N, 3)."""
        blocks = (xyz[:, :2] - np.asarray(self._low)) / (_BLOCK * self._cell_size_m)
        most = np.array(self._planes.shape[:2]) - 1
        rows, columns = np.clip(blocks.astype(np.int64), 0, most).T
        return np.asarray(self._planes[rows, columns, 1:] / self._cell_size_m, np.float32)


def ground_mask(xyz: Floats32, settings: GroundSettings) -> Bools:
    """Mask (N,) of the points (N, 3), metres, z up, that are ground: below the margin."""
    return np.asarray(GroundSurface(xyz, settings).heights(xyz) <= settings.margin_m)


@compiled("float32[:, ::1](float32[:, ::1], float64, float64, float64, float64, float64)")
def _lowest(
    xyz: Floats32, low_x: float, low_y: float, high_x: float, high_y: float, cell_size_m: float
) -> Floats32:
    """The height of the lowest point of each cell (rows, columns); infinity without one."""
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
    return lowest.reshape(num_rows, num_columns)


@compiled("float64[:, :, ::1](float32[:, ::1], float64[:, :, ::1], float64)")
def _summed(lowest: Floats32, planes: Floats, tolerance_m: float) -> Floats:
    """Sums over all cells before each block (rows + 1, columns + 1, 9).

    They are those of the weight of a cell, and of its products with x, y, xx, xy, yy, z, zx and zy.
    """
    num_rows, num_columns = planes.shape[:2]
    sums = np.zeros((num_rows + 1, num_columns + 1, 9))
    half = (_BLOCK - 1) / 2
    for row in range(lowest.shape[0]):
        for column in range(lowest.shape[1]):
            z = np.float64(lowest[row, column])
            if z == np.inf:
                continue
            block_row, block_column = row // _BLOCK, column // _BLOCK
            x, y = np.float64(row), np.float64(column)
            height, along, across = planes[block_row, block_column]
            on_plane = height + along * (x - _BLOCK * block_row - half)
            on_plane += across * (y - _BLOCK * block_column - half)
            off = (z - on_plane) / tolerance_m
            weight = 1.0 / (1.0 + off * off)
            # What is above stands on the ground more often than it is ground.
            weight *= weight if off > 0 else 1.0
            own = sums[block_row + 1, block_column + 1]
            own[0] += weight
            own[1] += weight * x
            own[2] += weight * y
            own[3] += weight * x * x
            own[4] += weight * x * y
            own[5] += weight * y * y
            own[6] += weight * z
            own[7] += weight * z * x
            own[8] += weight * z * y
    for row in range(1, num_rows + 1):
        for column in range(1, num_columns + 1):
            for each in range(9):
                beside = sums[row - 1, column, each] + sums[row, column - 1, each]
                sums[row, column, each] += beside - sums[row - 1, column - 1, each]
    return sums


@compiled("float64[:, :, ::1](float32[:, ::1], float64[:, :, ::1], int64, float64)")
def _fitted(lowest: Floats32, planes: Floats, reach: int, tolerance_m: float) -> Floats:
    """Planes of blocks (rows, columns, 3): height in the middle, rise per cell along x and y.

    A plane is fitted to the cells within reach, in blocks, that are close to the planes before. The
    plane before counts as much as one cell in the middle of the block and one each beside it.
    """
    sums = _summed(lowest, planes, tolerance_m)
    num_rows, num_columns = planes.shape[:2]
    fitted, prior = np.empty_like(planes), np.float64(_BLOCK * _BLOCK)
    own = np.empty(9)
    for row in range(num_rows):
        top, bottom = max(row - reach, 0), min(row + reach + 1, num_rows)
        for column in range(num_columns):
            left, right = max(column - reach, 0), min(column + reach + 1, num_columns)
            for each in range(9):
                own[each] = sums[bottom, right, each] - sums[top, right, each]
                own[each] += sums[top, left, each] - sums[bottom, left, each]
            x, y = _BLOCK * (row + 0.5) - 0.5, _BLOCK * (column + 0.5) - 0.5
            height, along, across = planes[row, column]
            # From here on, all is as seen from the middle of the block.
            number, sum_x, sum_y = own[0], own[1] - x * own[0], own[2] - y * own[0]
            sum_xx = own[3] - x * (own[1] + sum_x)
            sum_xy = own[4] - x * own[2] - y * sum_x
            sum_yy = own[5] - y * (own[2] + sum_y)
            # What the plane before leaves.
            left_z = own[6] - height * number - along * sum_x - across * sum_y
            left_x = own[7] - x * own[6] - height * sum_x - along * sum_xx - across * sum_xy
            left_y = own[8] - y * own[6] - height * sum_y - along * sum_xy - across * sum_yy
            number += 1.0
            xx = sum_xx + prior - sum_x * sum_x / number
            yy = sum_yy + prior - sum_y * sum_y / number
            xy = sum_xy - sum_x * sum_y / number
            to_x, to_y = left_x - sum_x * left_z / number, left_y - sum_y * left_z / number
            determinant = xx * yy - xy * xy
            more_along = (to_x * yy - to_y * xy) / determinant
            more_across = (to_y * xx - to_x * xy) / determinant
            more = (left_z - sum_x * more_along - sum_y * more_across) / number
            fitted[row, column, 0] = height + more
            fitted[row, column, 1] = along + more_along
            fitted[row, column, 2] = across + more_across
    return fitted


@compiled("float32[::1](float32[:, ::1], float64, float64, float64, float64[:, :, ::1])")
def _heights(
    xyz: Floats32, low_x: float, low_y: float, cell_size_m: float, planes: Floats
) -> Floats32:
    """(N,) metres, how far points (N, 3) are above the planes of their blocks."""
    heights = np.empty(len(xyz), np.float32)
    last_row, last_column = planes.shape[0] - 1, planes.shape[1] - 1
    for point in range(len(xyz)):
        x = (np.float64(xyz[point, 0]) - low_x) / cell_size_m
        y = (np.float64(xyz[point, 1]) - low_y) / cell_size_m
        # Beyond the points that the planes were fitted to, the outermost ones go on.
        row = min(max(int(x / _BLOCK), 0), last_row)
        column = min(max(int(y / _BLOCK), 0), last_column)
        height, along, across = planes[row, column]
        ground = height + along * (x - _BLOCK * (row + 0.5))
        ground += across * (y - _BLOCK * (column + 0.5))
        heights[point] = np.float64(xyz[point, 2]) - ground
    return heights
