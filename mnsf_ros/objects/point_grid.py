"""The points of a sweep in cells: how far, and in which direction, they are from objects."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled

# Longest search radius, one cell: the nearest point is in a cell that touches that of the place.
MAX_REACH_M: Final = 0.625
_CELL_M: Final = np.float32(MAX_REACH_M)
# Cells share buckets; what is in another cell of the same bucket is too far off to count.
_NUM_BUCKETS: Final = 2**17
_ACROSS: Final = 73_856_093
_ALONG: Final = 19_349_663
# Cells farther out than this are all the same: their numbers would not fit into integers.
_MAX_CELL: Final = np.float32(1e9)


class PointGrid:
    """Points, sorted by the cells they are in."""

    def __init__(self, points: NDArray[np.float32]) -> None:
        """Sorts points (T, 3), in metres."""
        self._starts, self._points = _in_buckets(np.ascontiguousarray(points))

    def compared(
        self,
        positions: NDArray[np.float32],
        owners: NDArray[np.int64],
        motions: NDArray[np.float32],
        transform: NDArray[np.float64],
        within_m: NDArray[np.float32],
        reach_m: float,
        limits_m: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Compares the points of objects with those of the grid.

        Args:
            positions: (P, 3) metres, of K objects.
            owners: (P,) from 0 to K - 1, their objects.
            motions: (K, 3) metres, added to the positions.
            transform: (4, 4) from the frame of the positions to that of the grid.
            within_m: (P,) metres; a point of the grid that is nearer is as good as the nearest one.
            reach_m: Points farther off do not count, at most `MAX_REACH_M`.
            limits_m: (K,) metres; points are left out once the sum of distances is above. None: all
                points count.

        Returns:
            Sums over each object's points: (K,) distances beyond `within_m`, at most `reach_m`;
            (K, 3) vectors to points of the grid in reach, in its frame; (K,) how many have one.
        """
        if limits_m is None:
            limits_m = np.full(len(motions), np.inf)
        return _compared(
            positions,
            owners,
            np.ascontiguousarray(motions, np.float32),
            np.ascontiguousarray(transform[:3], np.float32),
            within_m,
            np.float32(reach_m),
            limits_m,
            self._starts,
            self._points,
        )


@compiled("Tuple((int32[::1], float32[:, ::1]))(float32[:, ::1])")
def _in_buckets(
    points: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """The start of each bucket and the end of the last one, and the points in their order."""
    starts = np.zeros(_NUM_BUCKETS + 1, np.int32)
    buckets = np.zeros(len(points), np.int32)
    for row in range(len(points)):
        x = np.floor(points[row, 0] / _CELL_M)
        y = np.floor(points[row, 1] / _CELL_M)
        z = np.floor(points[row, 2] / _CELL_M)
        if abs(x) < _MAX_CELL and abs(y) < _MAX_CELL and abs(z) < _MAX_CELL:
            cell = (int(x) * _ACROSS ^ int(y) * _ALONG) + int(z)
            buckets[row] = cell & (_NUM_BUCKETS - 1)
        starts[buckets[row]] += 1
    for bucket in range(_NUM_BUCKETS):
        starts[bucket + 1] += starts[bucket]
    ordered = np.empty_like(points)
    for row in range(len(points) - 1, -1, -1):
        starts[buckets[row]] -= 1
        ordered[starts[buckets[row]]] = points[row]
    return starts, ordered


@compiled(
    "Tuple((int64, float32))"
    "(float32, float32, float32, float32, float32, int32[::1], float32[:, ::1])"
)
def _nearest(
    px: np.float32,
    py: np.float32,
    pz: np.float32,
    within_m: np.float32,
    reach_m: np.float32,
    starts: NDArray[np.int32],
    points: NDArray[np.float32],
) -> tuple[int, np.float32]:
    """The row of the nearest point, -1 without one in reach, and its squared distance."""
    row, least = -1, reach_m * reach_m
    x, y, z = np.floor(px / _CELL_M), np.floor(py / _CELL_M), np.floor(pz / _CELL_M)
    if not (abs(x) < _MAX_CELL and abs(y) < _MAX_CELL and abs(z) < _MAX_CELL):
        return row, least
    # How far it is to the cells before, the same one and the next, along each axis.
    ix, iy, iz = int(x), int(y), int(z)
    in_x, in_y, in_z = px - x * _CELL_M, py - y * _CELL_M, pz - z * _CELL_M
    gaps_x = (in_x, np.float32(0.0), _CELL_M - in_x)
    gaps_y = (in_y, np.float32(0.0), _CELL_M - in_y)
    gaps_z = (in_z, np.float32(0.0), _CELL_M - in_z)
    enough = within_m * within_m
    for by_x in (0, -1, 1):
        gap_x = gaps_x[by_x + 1] ** 2
        for by_y in (0, -1, 1):
            gap_xy = gap_x + gaps_y[by_y + 1] ** 2
            if gap_xy >= least or least <= enough:
                continue
            column = (ix + by_x) * _ACROSS ^ (iy + by_y) * _ALONG
            for by_z in (0, -1, 1):
                if gap_xy + gaps_z[by_z + 1] ** 2 >= least or least <= enough:
                    continue
                bucket = column + iz + by_z & (_NUM_BUCKETS - 1)
                for other in range(starts[bucket], starts[bucket + 1]):
                    dx, dy, dz = points[other, 0] - px, points[other, 1] - py, points[other, 2] - pz
                    squared = dx * dx + dy * dy + dz * dz
                    if squared < least:
                        row, least = other, squared
    return row, least


@compiled(
    "Tuple((float64[::1], float64[:, ::1], int64[::1]))"
    "(float32[:, ::1], int64[::1], float32[:, ::1], float32[:, ::1], float32[::1], float32,"
    " float64[::1], int32[::1], float32[:, ::1])"
)
def _compared(
    positions: NDArray[np.float32],
    owners: NDArray[np.int64],
    motions: NDArray[np.float32],
    transform: NDArray[np.float32],
    within_m: NDArray[np.float32],
    reach_m: np.float32,
    limits_m: NDArray[np.float64],
    starts: NDArray[np.int32],
    points: NDArray[np.float32],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    distances = np.zeros(len(motions))
    vectors = np.zeros((len(motions), 3))
    counts = np.zeros(len(motions), np.int64)
    here = np.zeros(3, np.float32)
    for row in range(len(positions)):
        owner = owners[row]
        if distances[owner] > limits_m[owner]:
            continue
        x = positions[row, 0] + motions[owner, 0]
        y = positions[row, 1] + motions[owner, 1]
        z = positions[row, 2] + motions[owner, 2]
        for axis in range(3):
            turned = x * transform[axis, 0] + y * transform[axis, 1] + z * transform[axis, 2]
            here[axis] = turned + transform[axis, 3]
        nearest, squared = _nearest(
            here[0], here[1], here[2], within_m[row], reach_m, starts, points
        )
        distances[owner] += max(np.sqrt(squared) - within_m[row], np.float32(0.0))
        if nearest >= 0:
            counts[owner] += 1
            for axis in range(3):
                vectors[owner, axis] += points[nearest, axis] - here[axis]
    return distances, vectors, counts
