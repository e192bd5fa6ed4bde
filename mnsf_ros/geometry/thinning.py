"""Fewer points: one for each cell that has any."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled

# Cells are numbered with 21 bits an axis; what is farther out is in the outermost ones.
_HALF: Final = 2**20
_ACROSS: Final = 73_856_093
_ALONG: Final = 19_349_663
_UP: Final = 83_492_791


def thinned(xyz: NDArray[np.float32], cell_m: float) -> NDArray[np.float32]:
    """Returns the mean of the points (N, 3) in each cell, (M, 3).

    They come by height, then from right to left and from back to front: each n-th of them is spread
    over all places as evenly as all are.
    """
    means, keys = _means_of_cells(np.require(xyz, requirements=("C", "W")), 1 / cell_m)
    return means[np.argsort(keys)]


@compiled("Tuple((float32[:, ::1], int64[::1]))(float32[:, ::1], float64)")
def _means_of_cells(
    xyz: NDArray[np.float32], cells_per_m: float
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    # A table with open addressing: half of its places stay free.
    size = 16
    while size < 2 * len(xyz):
        size *= 2
    keys, cells = np.full(size, -1, np.int64), np.empty(size, np.int32)
    sums, counts = np.zeros((len(xyz), 3)), np.zeros(len(xyz), np.int32)
    own_keys = np.empty(len(xyz), np.int64)
    number = 0
    for row in range(len(xyz)):
        key, place = np.int64(0), np.int64(0)
        for axis, factor in enumerate((_ACROSS, _ALONG, _UP)):
            scaled = min(max(xyz[row, axis] * cells_per_m, -_HALF), _HALF - 1)
            index = int(np.floor(scaled)) + _HALF
            key |= index << 21 * axis
            place ^= index * factor
        place &= size - 1
        while keys[place] not in (key, -1):
            place = place + 1 & size - 1
        if keys[place] == -1:
            keys[place], cells[place], own_keys[number] = key, number, key
            number += 1
        cell = cells[place]
        counts[cell] += 1
        for axis in range(3):
            sums[cell, axis] += xyz[row, axis]
    means = np.empty((number, 3), np.float32)
    for cell in range(number):
        for axis in range(3):
            means[cell, axis] = sums[cell, axis] / counts[cell]
    return means, own_keys[:number]
