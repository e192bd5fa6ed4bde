# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A map of the surfaces in the last sweeps, and the residuals of points to them."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Floats32, Ints, Ints32
from mnsf_ros.compiled import compiled
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.surfaces import add_moments, compare, fit_surfaces

# Cells not seen for long are dropped each time this many sweeps were added.
_SWEEPS_TO_CLEAR: Final = 10
_MIN_ROOM: Final = 2**12
# The first sensor is in the middle of a cell: simulated walls stand at round numbers of metres, and
# at a border half of their points would be in one cell and half in the next.
_FIRST_BORDER: Final = 0.5
# Farther away, cell numbers would not fit into integers: there is no map.
_MAX_WAY_M: Final = 1e9
# Numbers of cells have 21 bits an axis in the keys; farther ones share them.
_MASK: Final = 2**21 - 1
_ACROSS: Final = 73_856_093
_ALONG: Final = 19_349_663
_UP: Final = 83_492_791


@dataclass(frozen=True, eq=False)
class Comparison:
    """Residuals of points to the surfaces of a map, and the normal equations that reduce them.

    Attributes:
        support: Points on the surface of their cell; one that is off by the noise counts half.
        num_known: Points in cells that are not empty.
        gradient: (U,) of -noise^2 / 2 times the support, with respect to a shift of the points
            along the world axes in metres, then to a turn about the sensor in radians. U is 6. It
            is 12 for clouds of several parts: the velocity follows, in the same units per second.
        curvature: (U, U) its derivative with fixed weights of the points.
    """

    support: float
    num_known: int
    gradient: Floats
    curvature: Floats

    @property
    def has_velocity(self) -> bool:
        """Whether the velocity is among the unknowns."""
        return len(self.gradient) > 6

    @property
    def upright(self) -> float:
        """Total weight of the points on upright surfaces, which constrain the position."""
        return float(self.curvature[0, 0] + self.curvature[1, 1])


class SurfaceMap:
    """Points of sweeps in cells, and the surface in each cell."""

    def __init__(self, cell_m: float, num_sweeps: int) -> None:
        """Makes an empty map.

        Args:
            cell_m: Size of the cells.
            num_sweeps: Cells are dropped when not seen for this many sweeps.
        """
        self._cell_m = cell_m
        self._num_sweeps = num_sweeps
        self._num_added = 0
        self._origin: Floats = np.zeros(3)
        self._num = 0
        self._make_room(_MIN_ROOM)

    @property
    def is_empty(self) -> bool:
        """True before the first sweep."""
        return self._num_added == 0

    def add(self, cloud: Cloud, poses: Floats) -> None:
        """Adds a cloud whose parts were measured at poses (K, 4, 4)."""
        middle = poses[len(poses) // 2]
        if self.is_empty:
            self._origin = middle[:3, 3] - _FIRST_BORDER * self._cell_m
        moved = self._moved(cloud, poses)
        if moved is None:
            return
        self._num_added += 1
        if self._num_added % _SWEEPS_TO_CLEAR == 0 or self._num + len(cloud) > len(self._seen):
            self._clear(len(cloud))
        cells = self._cells_of(moved, adding=True)
        self._seen[cells] = self._num_added
        where = (cells, self._indices, self._cell_m, self._moments, self._num_new)
        add_moments(moved, *where)
        sensor = np.stack([middle[:3, 3] - self._origin, middle[:3, :3] @ cloud.beam_axis])
        fit_surfaces(*where, sensor, self._surfaces)

    def compared(self, cloud: Cloud, poses: Floats, noise_m: float) -> Comparison:
        """Compares a cloud with the map.

        Args:
            cloud: The cloud.
            poses: (K, 4, 4) of the sensor, one for each part.
            noise_m: A point at this distance from the surface of its cell counts half.
        """
        equations, found = np.zeros((len(poses), 6, 7)), (0.0, 0)
        moved = self._moved(cloud, poses)
        if moved is not None:
            cells = self._cells_of(moved, adding=False)
            sensor = tuple((poses[len(poses) // 2, :3, 3] - self._origin).tolist())
            where = (moved, cloud.parts, cells)
            found = compare(*where, self._surfaces, sensor, noise_m, equations)
        return Comparison(*found, *_of_velocity(equations, cloud.part_times_s))

    def _moved(self, cloud: Cloud, poses: Floats) -> Floats | None:
        """(N, 3) metres from the origin of the map, axes of the world; None far from it."""
        own = poses[:, :3].copy()
        own[:, :, 3] -= self._origin
        if not np.abs(own[:, :, 3]).max() < _MAX_WAY_M:
            return None
        return _transformed(cloud.points, cloud.parts, own)

    def _cells_of(self, points: Floats, *, adding: bool) -> Ints32:
        """(N,) the cells of points (N, 3); -1 where there is none, unless they are added."""
        cells = np.empty(len(points), np.int32)
        self._num = _find_cells(
            points,
            1 / self._cell_m,
            adding,
            self._num,
            self._keys,
            self._places,
            self._indices,
            cells,
        )
        return cells

    def _clear(self, num_points: int) -> None:
        """Drops cells not seen for long, and makes room for cells of new points."""
        is_kept = self._seen[: self._num] >= self._num_added - self._num_sweeps
        kept = np.flatnonzero(is_kept)
        centers = ((self._indices[kept] + 0.5) * self._cell_m).astype(np.float64, copy=False)
        old = (self._seen, self._moments, self._num_new, self._surfaces)
        room = _MIN_ROOM
        while room < len(kept) + num_points:
            room *= 2
        self._make_room(room)
        self._cells_of(centers, adding=True)
        new = (self._seen, self._moments, self._num_new, self._surfaces)
        for column, from_column in zip(new, old, strict=True):
            column[: len(kept)] = from_column[kept]

    def _make_room(self, room: int) -> None:
        """Makes an empty table of cells, with twice as many keys as cells for fast search."""
        self._num = 0
        self._keys: Ints = np.full(2 * room, -1, np.int64)
        self._places: Ints32 = np.empty(2 * room, np.int32)
        self._indices: Ints = np.empty((room, 3), np.int64)
        self._seen = np.zeros(room, np.int64)
        # Sums of the products of (x, y, z, 1) from the middle of the cell.
        self._moments = np.zeros((room, 4, 4))
        self._num_new = np.zeros(room)  # points since the surface was fitted
        self._surfaces = np.zeros((room, 4, 3))  # the center, and the weights


def _of_velocity(equations: Floats, times_s: Floats) -> tuple[Floats, Floats]:
    """Gradient (U,) and curvature (U, U) by the equations (K, 6, 7) of parts at some times (K,).

    A velocity moves a part in proportion to its time.
    """
    if len(times_s) == 1:
        return equations[0, :, 6], equations[0, :, :6]
    plain, once, twice = np.tensordot(times_s ** np.arange(3)[:, None], equations, 1)
    gradient = np.concatenate([plain[:, 6], once[:, 6]])
    return gradient, np.block([[plain[:, :6], once[:, :6]], [once[:, :6], twice[:, :6]]])


@compiled("float64[:, ::1](float32[:, ::1], int32[::1], float64[:, :, ::1])")
def _transformed(points: Floats32, parts: Ints32, transforms: Floats) -> Floats:
    result = np.empty((len(points), 3))
    for row in range(len(points)):
        part, x, y, z = parts[row], points[row, 0], points[row, 1], points[row, 2]
        for axis in range(3):
            turned = x * transforms[part, axis, 0] + y * transforms[part, axis, 1]
            turned += z * transforms[part, axis, 2]
            result[row, axis] = turned + transforms[part, axis, 3]
    return result


@compiled(
    "int64(float64[:, ::1], float64, boolean, int64, int64[::1], int32[::1], int64[:, ::1],"
    " int32[::1])"
)
def _find_cells(
    points: Floats,
    cells_per_m: float,
    adding: bool,
    number: int,
    keys: Ints,
    places: Ints32,
    indices: Ints,
    cells: Ints32,
) -> int:
    """Finds the cell of each point in a table with open addressing; returns how many there are."""
    last = len(keys) - 1
    for row in range(len(points)):
        x = int(np.floor(points[row, 0] * cells_per_m))
        y = int(np.floor(points[row, 1] * cells_per_m))
        z = int(np.floor(points[row, 2] * cells_per_m))
        key = (x & _MASK) << 42 | (y & _MASK) << 21 | (z & _MASK)
        place = (x * _ACROSS ^ y * _ALONG ^ z * _UP) & last
        while keys[place] != key and keys[place] != -1:
            place = place + 1 & last
        if keys[place] == key:
            cells[row] = places[place]
        elif adding:
            keys[place], places[place], cells[row] = key, number, number
            indices[number, 0], indices[number, 1], indices[number, 2] = x, y, z
            number += 1
        else:
            cells[row] = -1
    return number
