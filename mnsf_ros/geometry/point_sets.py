# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Selection, bounds and thinning of points, compiled."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32, Ints
from mnsf_ros.compiled import compiled

# Cell numbers have 21 bits an axis; points farther out are in the outermost cells.
_HALF: Final = 2**20
_ACROSS: Final = 73_856_093
_ALONG: Final = 19_349_663
_UP: Final = 83_492_791
# A grid over points that reach farther than this many cells has larger ones: memory stays bounded.
MAX_CELLS_PER_AXIS: Final = 2048


@compiled("float32[:, ::1](float32[:, ::1], boolean[::1])")
def chosen_points(xyz: Floats32, mask: Bools) -> Floats32:
    """Returns `xyz[mask]`, points (M, 3) of (N, 3); NumPy takes two to ten times as long."""
    end, number = min(len(mask), len(xyz)), 0
    for row in range(end):
        number += mask[row]
    chosen = np.empty((number, 3), np.float32)
    place = 0
    for row in range(end):
        if mask[row]:
            for axis in range(3):
                chosen[place, axis] = xyz[row, axis]
            place += 1
    return chosen


@compiled("UniTuple(float32, 4)(float32[:, ::1])")
def bounds(xyz: Floats32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Returns the lowest x and y, and the highest x and y, of points (N, 3) with N > 0."""
    low_x = high_x = xyz[0, 0]
    low_y = high_y = xyz[0, 1]
    # Of a flat array the compiler knows the steps.
    values = xyz.reshape(-1)
    for row in range(len(xyz)):
        x, y = values[3 * row], values[3 * row + 1]
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    return low_x, low_y, high_x, high_y


def thinned(rows: Floats32, cell_m: float) -> Floats32:
    """Returns the mean of the rows (N, C) in each cell, (M, C); columns are x, y, z and others.

    Their order is by height, then from right to left and from back to front: each n-th of them is
    spread as evenly as all are.
    """
    means, keys = _means_of_cells(np.require(rows, requirements=("C", "W")), 1 / cell_m)
    # np.take is several times faster than means[...].
    return np.take(means, np.argsort(keys), axis=0)


@compiled("int64(float32, float64)")
def _index(place_m: np.float32, cells_per_m: float) -> int:
    """Returns the number of a cell along an axis, from 0 on."""
    return int(np.floor(min(max(place_m * cells_per_m, -_HALF), _HALF - 1))) + _HALF


@compiled("Tuple((float32[:, ::1], int64[::1]))(float32[:, ::1], float64)")
def _means_of_cells(rows: Floats32, cells_per_m: float) -> tuple[Floats32, Ints]:
    # A table with open addressing; at least a third of its places stays free.
    size = 16
    while 2 * size < 3 * len(rows):
        size *= 2
    cells = np.full(size, -1, np.int32)
    # Of x, y, z and 1, and of further columns: loops over a known number of columns are faster.
    sums, own_keys = np.empty((len(rows), 4)), np.empty(len(rows), np.int64)
    further = np.zeros((len(rows), rows.shape[1] - 3))
    number = 0
    for row in range(len(rows)):
        x, y, z = rows[row, 0], rows[row, 1], rows[row, 2]
        across, along = _index(x, cells_per_m), _index(y, cells_per_m)
        up = _index(z, cells_per_m)
        key = across | along << 21 | up << 42
        place = (across * _ACROSS ^ along * _ALONG ^ up * _UP) & size - 1
        while cells[place] != -1 and own_keys[cells[place]] != key:
            place = place + 1 & size - 1
        if cells[place] == -1:
            cells[place], own_keys[number] = number, key
            for column in range(4):
                sums[number, column] = 0.0
            number += 1
        cell = cells[place]
        sums[cell, 0] += x
        sums[cell, 1] += y
        sums[cell, 2] += z
        sums[cell, 3] += 1.0
        for column in range(further.shape[1]):
            further[cell, column] += rows[row, 3 + column]
    means = np.empty((number, rows.shape[1]), np.float32)
    for cell in range(number):
        for column in range(3):
            means[cell, column] = sums[cell, column] / sums[cell, 3]
        for column in range(further.shape[1]):
            means[cell, 3 + column] = further[cell, column] / sums[cell, 3]
    return means, own_keys[:number]
