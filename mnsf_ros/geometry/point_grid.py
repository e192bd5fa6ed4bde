# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points of a sweep in cells: the nearest point, and distances from moved objects."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints, Ints32
from mnsf_ros.compiled import compiled

# No search goes farther: a residual is at most this, and parts of one mover are no farther apart.
REACH_M: Final = 0.5
# The nearest point is in a cell that touches that of the place. Most often it is the same one if
# cells are a little larger than the reach.
_CELL_M: Final = np.float32(1.25 * REACH_M)
# Places farther out are in the outermost cells: numbers of cells have 21 bits.
_HALF: Final = 2**20


class PointGrid:
    """Points, sorted by the cells they are in.

    Attributes:
        starts: (B + 1,) where each bucket of cells begins, and where the last one ends.
        points: (T, 3) float32, metres, in the order of their buckets.
    """

    def __init__(self, points: NDArray[np.floating]) -> None:
        """Sorts points (T, 3), in metres."""
        own = np.ascontiguousarray(points, np.float32)
        self.starts, self.points, self._rows = _in_buckets(own)

    def nearest(self, places: NDArray[np.floating], reach_m: float = REACH_M) -> Ints:
        """Returns (P,) the row of the point nearest to each place, -1 where none is in reach.

        Args:
            places: (P, 3) metres.
            reach_m: At most `REACH_M`.
        """
        own = np.ascontiguousarray(places, np.float32)
        return _rows_of_nearest(own, np.float32(reach_m), self.starts, self.points, self._rows)

    def within_reach(self, places: Floats32, owners: Ints, of_points: Ints) -> Bools:
        """Returns (K, K) which owners of places have a point of which other owner in reach.

        Args:
            places: (P, 3) metres.
            owners: (P,) from 0 to K - 1, of the places.
            of_points: (T,) likewise, of the points of the grid.
        """
        number = int(max(owners.max(initial=-1), of_points.max(initial=-1))) + 1
        in_order = of_points[self._rows]
        return _within_reach(places, owners, in_order, number, self.starts, self.points)

    def compared(
        self,
        positions: Floats32,
        owners: Ints,
        motions: Floats32,
        transform: Floats,
        within_m: Floats32,
        limits_m: Floats32 | None = None,
        max_sum_m: Floats | None = None,
    ) -> tuple[Floats, Floats, Ints]:
        """Compares the points of objects with those of the grid.

        Args:
            positions: (P, 3) metres, of K objects.
            owners: (P,) from 0 to K - 1, their objects.
            motions: (K, 3) metres, added to the positions.
            transform: (4, 4) from the frame of the positions to that of the grid.
            within_m: (P,) metres; a point of the grid that is nearer is as good as the nearest one.
            limits_m: (P,) metres, the largest distance beyond `within_m` that counts for a point.
            max_sum_m: (K,) metres; from where its sum of distances is above, the other points of an
                object are left out.

        Returns:
            Sums over each object's points: (K,) distances beyond `within_m`, at most `REACH_M`;
            (K, 3) vectors to points of the grid in reach, in its frame; (K,) how many have one.
        """
        return _compared(
            positions,
            owners,
            np.ascontiguousarray(motions, np.float32),
            np.ascontiguousarray(transform[:3], np.float32),
            within_m,
            np.full(len(positions), np.float32(REACH_M)) if limits_m is None else limits_m,
            np.full(len(motions), np.inf) if max_sum_m is None else max_sum_m,
            self.starts,
            self.points,
        )


@compiled("int64(float32)")
def _cell(place_m: np.float32) -> int:
    """The number of a cell along an axis."""
    return int(np.floor(max(-_HALF, min(_HALF - 1, float(place_m / _CELL_M)))))


@compiled("int64(int64, int64, int64)")
def _hashed(across: int, along: int, up: int) -> int:
    """A number that differs for most cells; that of the cell above is higher by one."""
    return (across * 73_856_093 ^ along * 19_349_663) + up


@compiled("Tuple((int32[::1], float32[:, ::1], int32[::1]))(float32[:, ::1])")
def _in_buckets(points: Floats32) -> tuple[Ints32, Floats32, Ints32]:
    """Sorts points (T, 3), in metres, by the buckets of their cells.

    Returns:
        The start of each bucket and the end of the last one, the points in their order, and (T,)
        their rows.
    """
    # Cells share buckets; what is in another cell of the same bucket is too far off to count.
    number = 1
    while number < 2 * len(points):
        number *= 2
    starts = np.zeros(number + 1, np.int32)
    buckets = np.empty(len(points), np.int32)
    for row in range(len(points)):
        x, y, z = _cell(points[row, 0]), _cell(points[row, 1]), _cell(points[row, 2])
        buckets[row] = _hashed(x, y, z) & (number - 1)
        starts[buckets[row]] += 1
    for bucket in range(number):
        starts[bucket + 1] += starts[bucket]
    ordered, rows = np.empty_like(points), np.empty(len(points), np.int32)
    for row in range(len(points) - 1, -1, -1):
        starts[buckets[row]] -= 1
        place = starts[buckets[row]]
        rows[place] = row
        for axis in range(3):
            ordered[place, axis] = points[row, axis]
    return starts, ordered, rows


@compiled(
    "Tuple((int64, float32))"
    "(int64, float32, float32, float32, int64, float32, float32, int32[::1], float32[:, ::1])"
)
def _nearer(
    bucket: int,
    x: np.float32,
    y: np.float32,
    z: np.float32,
    row: int,
    least: np.float32,
    enough: np.float32,
    starts: Ints32,
    points: Floats32,
) -> tuple[int, np.float32]:
    """The row of the nearest point in a bucket and its squared distance, if that is below least.

    The first one that is near enough ends the search.
    """
    number = np.uint64(bucket & (len(starts) - 2))
    # Without a sign, an index is not looked at whether it counts from the end.
    for other in range(np.uint32(starts[number]), np.uint32(starts[number + np.uint64(1)])):
        dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if squared < least:
            row, least = int(other), squared
            if least <= enough:
                break
    return row, least


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
    starts: Ints32,
    points: Floats32,
) -> tuple[int, np.float32]:
    """The row of the nearest point, -1 without one in reach, and its squared distance."""
    row, least = -1, reach_m * reach_m
    x, y, z = _cell(px), _cell(py), _cell(pz)
    in_x = px - np.float32(x) * _CELL_M
    in_y = py - np.float32(y) * _CELL_M
    in_z = pz - np.float32(z) * _CELL_M
    # Squared distances to the cells below and above.
    below, above = in_z * in_z, (_CELL_M - in_z) * (_CELL_M - in_z)
    enough = within_m * within_m
    for by_x in (0, -1, 1):
        to_x = np.float32(0.0) if by_x == 0 else in_x if by_x < 0 else _CELL_M - in_x
        if to_x * to_x >= least:
            continue
        for by_y in (0, -1, 1):
            to_y = np.float32(0.0) if by_y == 0 else in_y if by_y < 0 else _CELL_M - in_y
            beside = to_x * to_x + to_y * to_y
            if beside >= least:
                continue
            bucket = _hashed(x + by_x, y + by_y, z)
            row, least = _nearer(bucket, px, py, pz, row, least, enough, starts, points)
            if beside + below < least and least > enough:
                row, least = _nearer(bucket - 1, px, py, pz, row, least, enough, starts, points)
            if beside + above < least and least > enough:
                row, least = _nearer(bucket + 1, px, py, pz, row, least, enough, starts, points)
            if least <= enough:
                return row, least
    return row, least


@compiled(
    "boolean[:, ::1](float32[:, ::1], int64[::1], int64[::1], int64, int32[::1], float32[:, ::1])"
)
def _within_reach(
    places: Floats32, owners: Ints, of_points: Ints, number: int, starts: Ints32, points: Floats32
) -> Bools:
    """Loop of `PointGrid.within_reach`; owners of points are in the order of their buckets."""
    are_near = np.zeros((number, number), np.bool_)
    for row in range(len(places)):
        x, y, z = places[row]
        across, along, up = _cell(x), _cell(y), _cell(z)
        are_met = are_near[owners[row]]
        for by_x in range(-1, 2):
            for by_y in range(-1, 2):
                for by_z in range(-1, 2):
                    bucket = _hashed(across + by_x, along + by_y, up + by_z) & (len(starts) - 2)
                    for other in range(starts[bucket], starts[bucket + 1]):
                        dx, dy, dz = (
                            points[other, 0] - x,
                            points[other, 1] - y,
                            points[other, 2] - z,
                        )
                        if dx * dx + dy * dy + dz * dz <= REACH_M * REACH_M:
                            are_met[of_points[other]] = True
    return are_near


@compiled("int64[::1](float32[:, ::1], float32, int32[::1], float32[:, ::1], int32[::1])")
def _rows_of_nearest(
    places: Floats32, reach_m: np.float32, starts: Ints32, points: Floats32, rows: Ints32
) -> Ints:
    """Loop of `PointGrid.nearest`."""
    found = np.empty(len(places), np.int64)
    for place in range(len(places)):
        x, y, z = places[place, 0], places[place, 1], places[place, 2]
        nearest, _ = _nearest(x, y, z, np.float32(0.0), reach_m, starts, points)
        found[place] = rows[nearest] if nearest >= 0 else -1
    return found


@compiled(
    "Tuple((float64[::1], float64[:, ::1], int64[::1]))"
    "(float32[:, ::1], int64[::1], float32[:, ::1], float32[:, ::1], float32[::1],"
    " float32[::1], float64[::1], int32[::1], float32[:, ::1])"
)
def _compared(
    positions: Floats32,
    owners: Ints,
    motions: Floats32,
    transform: Floats32,
    within_m: Floats32,
    limits_m: Floats32,
    max_sum_m: Floats,
    starts: Ints32,
    points: Floats32,
) -> tuple[Floats, Floats, Ints]:
    """Loop of `PointGrid.compared`."""
    distances = np.zeros(len(motions))
    vectors = np.zeros((len(motions), 3))
    counts = np.zeros(len(motions), np.int64)
    to_x, to_y, to_z = transform[0], transform[1], transform[2]
    for row in range(len(positions)):
        owner = owners[row]
        if distances[owner] > max_sum_m[owner]:
            continue
        x = positions[row, 0] + motions[owner, 0]
        y = positions[row, 1] + motions[owner, 1]
        z = positions[row, 2] + motions[owner, 2]
        px = x * to_x[0] + y * to_x[1] + z * to_x[2] + to_x[3]
        py = x * to_y[0] + y * to_y[1] + z * to_y[2] + to_y[3]
        pz = x * to_z[0] + y * to_z[1] + z * to_z[2] + to_z[3]
        farthest = min(np.float32(REACH_M), within_m[row] + limits_m[row])
        nearest, squared = _nearest(px, py, pz, within_m[row], farthest, starts, points)
        beyond = max(np.sqrt(squared) - within_m[row], np.float32(0.0))
        distances[owner] += min(beyond, limits_m[row])
        if nearest >= 0:
            counts[owner] += 1
            vectors[owner, 0] += points[nearest, 0] - px
            vectors[owner, 1] += points[nearest, 1] - py
            vectors[owner, 2] += points[nearest, 2] - pz
    return distances, vectors, counts
