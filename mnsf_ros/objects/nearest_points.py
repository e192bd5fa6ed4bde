# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Compiled loops over points of objects and their nearest neighbours; see `point_grid`."""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled

# Longest search radius, one cell: the nearest point is in a cell that touches that of the place.
MAX_REACH_M: Final = 0.625
_CELL_M: Final = np.float32(MAX_REACH_M)
# Cells share buckets; what is in another cell of the same bucket is too far off to count.
_MIN_BUCKETS: Final = 2**10
_MAX_BUCKETS: Final = 2**17
_BUCKETS_PER_POINT: Final = 8
_ACROSS: Final = 73_856_093
_ALONG: Final = 19_349_663
# Cells farther out than this are all the same: their numbers would not fit into integers.
_MAX_CELL: Final = np.float32(1e9)


@compiled("Tuple((int32[::1], float32[:, ::1], int32[::1]))(float32[:, ::1])")
def in_buckets(
    points: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.int32]]:
    """Sorts points (T, 3), in metres, by the buckets of their cells.

    Returns:
        The start of each bucket and the end of the last one, the points in their order, and (T,)
        their rows.
    """
    number = _MIN_BUCKETS
    while number < _BUCKETS_PER_POINT * len(points) and number < _MAX_BUCKETS:
        number *= 2
    starts = np.zeros(number + 1, np.int32)
    buckets = np.zeros(len(points), np.int32)
    for row in range(len(points)):
        x = np.floor(points[row, 0] / _CELL_M)
        y = np.floor(points[row, 1] / _CELL_M)
        z = np.floor(points[row, 2] / _CELL_M)
        if abs(x) < _MAX_CELL and abs(y) < _MAX_CELL and abs(z) < _MAX_CELL:
            cell = (int(x) * _ACROSS ^ int(y) * _ALONG) + int(z)
            buckets[row] = cell & (number - 1)
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
    "(int64, float32, float32, float32, int64, float32, int32[::1], float32[:, ::1])"
)
def _nearer(
    bucket: int,
    x: np.float32,
    y: np.float32,
    z: np.float32,
    row: int,
    least: np.float32,
    starts: NDArray[np.int32],
    points: NDArray[np.float32],
) -> tuple[int, np.float32]:
    """The row of the nearest point in a bucket and its squared distance, if that is below least."""
    number = np.uint64(bucket & (len(starts) - 2))
    # Without a sign, an index is not looked at whether it counts from the end.
    for other in range(np.uint32(starts[number]), np.uint32(starts[number + np.uint64(1)])):
        dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if squared < least:
            row, least = int(other), squared
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
    starts: NDArray[np.int32],
    points: NDArray[np.float32],
) -> tuple[int, np.float32]:
    """The row of the nearest point, -1 without one in reach, and its squared distance."""
    row, least = -1, reach_m * reach_m
    x, y, z = np.floor(px / _CELL_M), np.floor(py / _CELL_M), np.floor(pz / _CELL_M)
    if not (abs(x) < _MAX_CELL and abs(y) < _MAX_CELL and abs(z) < _MAX_CELL):
        return row, least
    ix, iy, iz = int(x), int(y), int(z)
    in_x, in_y, in_z = px - x * _CELL_M, py - y * _CELL_M, pz - z * _CELL_M
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
            bucket = ((ix + by_x) * _ACROSS ^ (iy + by_y) * _ALONG) + iz
            row, least = _nearer(bucket, px, py, pz, row, least, starts, points)
            if beside + below < least and least > enough:
                row, least = _nearer(bucket - 1, px, py, pz, row, least, starts, points)
            if beside + above < least and least > enough:
                row, least = _nearer(bucket + 1, px, py, pz, row, least, starts, points)
            if least <= enough:
                return row, least
    return row, least


@compiled("int64[::1](float32[:, ::1], float32, int32[::1], float32[:, ::1], int32[::1])")
def rows_of_nearest(
    places: NDArray[np.float32],
    reach_m: np.float32,
    starts: NDArray[np.int32],
    points: NDArray[np.float32],
    rows: NDArray[np.int32],
) -> NDArray[np.int64]:
    """Loop of `PointGrid.nearest`."""
    found = np.empty(len(places), np.int64)
    for place in range(len(places)):
        x, y, z = places[place, 0], places[place, 1], places[place, 2]
        nearest, _ = _nearest(x, y, z, np.float32(0.0), reach_m, starts, points)
        found[place] = rows[nearest] if nearest >= 0 else -1
    return found


@compiled(
    "Tuple((float64[::1], float64[:, ::1], int64[::1]))"
    "(float32[:, ::1], int64[::1], float32[:, ::1], float32[:, ::1], float32[::1], float32,"
    " int32[::1], float32[:, ::1])"
)
def compared(
    positions: NDArray[np.float32],
    owners: NDArray[np.int64],
    motions: NDArray[np.float32],
    transform: NDArray[np.float32],
    within_m: NDArray[np.float32],
    reach_m: np.float32,
    starts: NDArray[np.int32],
    points: NDArray[np.float32],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Loop of `PointGrid.compared`."""
    distances = np.zeros(len(motions))
    vectors = np.zeros((len(motions), 3))
    counts = np.zeros(len(motions), np.int64)
    to_x, to_y, to_z = transform[0], transform[1], transform[2]
    for row in range(len(positions)):
        owner = owners[row]
        x = positions[row, 0] + motions[owner, 0]
        y = positions[row, 1] + motions[owner, 1]
        z = positions[row, 2] + motions[owner, 2]
        px = x * to_x[0] + y * to_x[1] + z * to_x[2] + to_x[3]
        py = x * to_y[0] + y * to_y[1] + z * to_y[2] + to_y[3]
        pz = x * to_z[0] + y * to_z[1] + z * to_z[2] + to_z[3]
        nearest, squared = _nearest(px, py, pz, within_m[row], reach_m, starts, points)
        distances[owner] += max(np.sqrt(squared) - within_m[row], np.float32(0.0))
        if nearest >= 0:
            counts[owner] += 1
            vectors[owner, 0] += points[nearest, 0] - px
            vectors[owner, 1] += points[nearest, 1] - py
            vectors[owner, 2] += points[nearest, 2] - pz
    return distances, vectors, counts


NUM_TARGETS: Final = 4
# What the loops below share. Of K objects: positions (P, 3) of their points, one object after the
# other; metres (P,) within which a point of a target is as good as the nearest one; the first
# point of each object (K,), and how many it has (K,).
_OBJECTS: Final = "Tuple((float32[:, ::1], float32[::1], int64[::1], int64[::1]))"
Objects: TypeAlias = tuple[
    NDArray[np.float32], NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]
]
# Of T targets: transforms (T, 3, 4) to them; how many of them are near in time, they are the first
# ones; and the buckets and points of four, of which those beyond T are not looked at.
_TARGETS: Final = (
    "Tuple((float32[:, :, ::1], int64, UniTuple(int32[::1], 4), UniTuple(float32[:, ::1], 4)))"
)
Targets: TypeAlias = tuple[
    NDArray[np.float32], int, tuple[NDArray[np.int32], ...], tuple[NDArray[np.float32], ...]
]


@compiled(
    "void(float64[:, ::1], int64, int64, int64, float64, float32, float32[:, :, :, ::1], "
    f"{_OBJECTS}, {_TARGETS})"
)
def _measure(
    residuals: NDArray[np.float64],
    row: int,
    owner: int,
    candidate: int,
    limit_m: float,
    reach_m: np.float32,
    shifts: NDArray[np.float32],
    objects: Objects,
    targets: Targets,
) -> None:
    """Writes the residuals of one object and one motion into a row of `residuals`.

    They are infinite from where their total is above the limit.
    """
    positions, within_m, firsts, counts = objects
    transforms, num_near, starts, points = targets
    num_targets, first, count = len(transforms), firsts[owner], counts[owner]
    left_m = limit_m
    for target in range(num_targets):
        size = num_near if target < num_near else num_targets - num_near
        most_m, total_m = left_m * size * count, 0.0
        own_starts, own_points = starts[target], points[target]
        for point in range(first, first + count):
            if total_m > most_m:
                break
            x = positions[point, 0] + shifts[target, candidate, owner, 0]
            y = positions[point, 1] + shifts[target, candidate, owner, 1]
            z = positions[point, 2] + shifts[target, candidate, owner, 2]
            px = x * transforms[target, 0, 0] + y * transforms[target, 0, 1]
            px = px + z * transforms[target, 0, 2] + transforms[target, 0, 3]
            py = x * transforms[target, 1, 0] + y * transforms[target, 1, 1]
            py = py + z * transforms[target, 1, 2] + transforms[target, 1, 3]
            pz = x * transforms[target, 2, 0] + y * transforms[target, 2, 1]
            pz = pz + z * transforms[target, 2, 2] + transforms[target, 2, 3]
            _, squared = _nearest(px, py, pz, within_m[point], reach_m, own_starts, own_points)
            total_m += max(np.sqrt(squared) - within_m[point], np.float32(0.0))
        residuals[row, target] = np.inf if total_m > most_m else total_m / count
        left_m -= residuals[row, target] / size


@compiled(f"float64[:, ::1](float64[::1], float32, float32[:, :, :, ::1], {_OBJECTS}, {_TARGETS})")
def residuals_of(
    limits_m: NDArray[np.float64],
    reach_m: np.float32,
    shifts: NDArray[np.float32],
    objects: Objects,
    targets: Targets,
) -> NDArray[np.float64]:
    """Loop of `PointGrids.residuals`."""
    residuals = np.empty((len(limits_m), len(shifts)))
    for owner in range(len(limits_m)):
        _measure(residuals, owner, owner, 0, limits_m[owner], reach_m, shifts, objects, targets)
    return residuals


@compiled("float64(float64[:, ::1], int64, int64)")
def _total(residuals: NDArray[np.float64], row: int, num_near: int) -> float:
    """Means of the first residuals of a row and of the others."""
    near, past, num_past = 0.0, 0.0, residuals.shape[1] - num_near
    for column in range(num_near):
        near += residuals[row, column]
    for column in range(num_near, residuals.shape[1]):
        past += residuals[row, column]
    return near / num_near + (past / num_past if num_past > 0 else 0.0)


@compiled(
    "void(float32[:, ::1], float64[:, ::1], float32[:, :, ::1], float64, float64, float32, "
    f"float32[:, :, :, ::1], {_OBJECTS}, {_TARGETS})"
)
def choose(
    motions: NDArray[np.float32],
    residuals: NDArray[np.float64],
    candidates: NDArray[np.float32],
    share: float,
    better_m: float,
    reach_m: np.float32,
    shifts: NDArray[np.float32],
    objects: Objects,
    targets: Targets,
) -> None:
    """Loop of `PointGrids.choose`; writes `motions` and `residuals`."""
    num_near = targets[1]
    trial = np.empty((1, residuals.shape[1]))
    for owner in range(len(motions)):
        for candidate in range(len(candidates)):
            is_same = True
            for axis in range(3):
                is_same &= candidates[candidate, owner, axis] == motions[owner, axis]
            if is_same:
                continue
            limit_m = share * _total(residuals, owner, num_near) - better_m
            _measure(trial, 0, owner, candidate, limit_m, reach_m, shifts, objects, targets)
            if _total(trial, 0, num_near) < limit_m:
                for axis in range(3):
                    motions[owner, axis] = candidates[candidate, owner, axis]
                for target in range(residuals.shape[1]):
                    residuals[owner, target] = trial[0, target]
