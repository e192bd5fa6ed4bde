# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The ceiling: a surface over the sensor, found as the ground is, upside down."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32, Ints
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.point_sets import MAX_CELLS_PER_AXIS, bounds
from mnsf_ros.settings import GroundSettings
from mnsf_ros.sweeps.ground_surface import GroundSurface

# Nothing that is so little above the sensor is a ceiling: a lidar needs room.
_MIN_ABOVE_M: Final = 0.3
# Below 3 degrees a lidar sees hardly any ceiling, but walls behind cars: without this limit and the
# next one, 1,086 points of a sweep of KITTI 0005 would be ceiling.
_MIN_RISE: Final = 0.05
# Of ceilings below `objects.max_height_m` little is seen farther out.
_REACH_M: Final = 40.0
# A ceiling is judged by the columns in a square of three of these.
_TILE_M: Final = 8.0
# First choices: so many columns of 0.5 m, 4 m2, must be on it, and this share of all that hang in
# the air. With 40 columns, corridors 2 m wide keep false movers.
_MIN_COLUMNS: Final = 16
_MIN_SHARE: Final = 0.6


def ceiling_mask(xyz: Floats32, are_above_ground: Bools, settings: GroundSettings) -> Bools:
    """Mask (N,) of the points (N, 3), metres, z up, that are on a ceiling.

    A column that hangs in the air has points at one height only, above the sensor: of walls, people
    and vehicles something is seen below. Where most such columns are on one smooth surface, this is
    the ceiling, with all points that are close to it and have nothing above them.

    Args:
        xyz: The points; finite where they are above the ground.
        are_above_ground: (N,) the points that count; ground does not.
        settings: Cells, window and margin of the ground; the ceiling has the same ones.
    """
    mask = np.zeros(len(xyz), np.bool_)
    rows, num_over = _near(np.require(xyz, requirements=("C", "W")), are_above_ground)
    if num_over < _MIN_COLUMNS:
        return mask
    points = np.take(xyz, rows, axis=0)
    low_x, low_y, high_x, high_y = map(float, bounds(points))
    cell_size_m = max(settings.cell_size_m, 2 * _REACH_M / MAX_CELLS_PER_AXIS)
    cells, lowest, highest = _columns(points, low_x, low_y, high_x, high_y, cell_size_m)
    row, column = np.nonzero((-np.inf < highest) & (highest < lowest + settings.margin_m))
    x, y = low_x + (row + 0.5) * cell_size_m, low_y + (column + 0.5) * cell_size_m
    hanging = np.stack([x, y, -highest[row, column]], axis=1).astype(np.float32)
    hanging = hanging[_are_over(hanging[:, 0], hanging[:, 1], lowest[row, column])]
    if len(hanging) < _MIN_COLUMNS:
        return mask
    surface = GroundSurface(hanging, settings)
    are_on_it = np.abs(surface.heights(hanging)) < settings.margin_m
    may_be = _are_over(*points.T) & _in_tiles(hanging, are_on_it, points)
    rows, cells, points = rows[may_be], cells[may_be], points[may_be]
    depths = surface.heights(points * np.array([1, 1, -1], np.float32))
    over = np.take(highest, cells) - points[:, 2]
    mask[rows[(np.abs(depths) < settings.margin_m) & (over < depths + settings.margin_m)]] = True
    return mask


def _are_over(x: Floats32, y: Floats32, z: Floats32) -> Bools:
    """Which places are high enough above the sensor."""
    return np.asarray((z > _MIN_ABOVE_M) & (z > _MIN_RISE * np.hypot(x, y)))


def _in_tiles(hanging: Floats32, are_on_it: Bools, points: Floats32) -> Bools:
    """Mask (N,) of the points (N, 3) in tiles in which, with those around, columns are a ceiling.

    Args:
        hanging: (K, 3) metres, columns that hang in the air.
        are_on_it: (K,) which of them are on the surface.
        points: Any.
    """
    first = np.floor(hanging[:, :2].min(axis=0) / _TILE_M).astype(np.int64) - 1
    tiles = np.floor(hanging[:, :2] / _TILE_M).astype(np.int64) - first
    shape = tiles.max(axis=0) + 2
    number, num_on_it = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    np.add.at(number, (*tiles.T,), 1)
    np.add.at(num_on_it, (*tiles.T,), are_on_it)
    number, num_on_it = _with_neighbours(number), _with_neighbours(num_on_it)
    are_ceiling = (num_on_it >= _MIN_COLUMNS) & (num_on_it > _MIN_SHARE * number)
    places = np.floor(points[:, :2] / _TILE_M).astype(np.int64) - first
    x, y = np.clip(places, 0, shape - 1).T
    return np.asarray(are_ceiling[x, y])


def _with_neighbours(counts: Ints) -> Ints:
    """The sums of counts (rows, columns) over each tile and the eight around it."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(counts, 1), (3, 3))
    return np.asarray(around.sum(axis=(2, 3)))


@compiled("Tuple((int64[::1], int64))(float32[:, ::1], boolean[::1])")
def _near(xyz: Floats32, mask: Bools) -> tuple[Ints, int]:
    """The rows in the mask within reach, and how many of them are over the sensor."""
    rows = np.empty(len(xyz), np.int64)
    number, num_over = 0, 0
    for row in range(len(xyz)):
        x, y, z = np.float64(xyz[row, 0]), np.float64(xyz[row, 1]), np.float64(xyz[row, 2])
        squared = x * x + y * y
        if mask[row] and squared < _REACH_M * _REACH_M:
            rows[number] = row
            number += 1
            num_over += int(z > _MIN_ABOVE_M and z * z > _MIN_RISE * _MIN_RISE * squared)
    return rows[:number], num_over


@compiled(
    "Tuple((int64[::1], float32[:, ::1], float32[:, ::1]))"
    "(float32[:, ::1], float64, float64, float64, float64, float64)"
)
def _columns(
    xyz: Floats32, low_x: float, low_y: float, high_x: float, high_y: float, cell_size_m: float
) -> tuple[Ints, Floats32, Floats32]:
    """The cell of each point, and the lowest and highest z of each (rows, columns)."""
    num_rows = int((high_x - low_x) / cell_size_m) + 1
    num_columns = int((high_y - low_y) / cell_size_m) + 1
    cells = np.empty(len(xyz), np.int64)
    lowest = np.full(num_rows * num_columns, np.float32(np.inf))
    highest = np.full(num_rows * num_columns, np.float32(-np.inf))
    for point in range(len(xyz)):
        row = int((np.float64(xyz[point, 0]) - low_x) / cell_size_m)
        column = int((np.float64(xyz[point, 1]) - low_y) / cell_size_m)
        cell = row * num_columns + column
        cells[point] = cell
        lowest[cell] = min(lowest[cell], xyz[point, 2])
        highest[cell] = max(highest[cell], xyz[point, 2])
    shape = (num_rows, num_columns)
    return cells, lowest.reshape(shape), highest.reshape(shape)
