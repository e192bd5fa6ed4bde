# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Range image of a sweep: which places it saw to be free."""

from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints32
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.sweeps.sweep import NOT_TILTED

# Cells span a few beams of common sensors. Those above and below that are empty, as between few
# beams, are passed over, up to this far.
NUM_AZIMUTHS: Final = 720
_NUM_ELEVATIONS: Final = 180
_NUM_REACHED: Final = 3
# Of the odd polynomial that is nearest to the arctangent from 0 to 1, highest power first.
_ARCTAN: Final = tuple(
    map(np.float32, (-0.011719, 0.052647, -0.116426, 0.19354, -0.332623, 0.999977))
)
# A place is free only if it is nearer than what is around by this plus this share of its range.
_MARGIN_M: Final = 0.2
_MARGIN_SHARE: Final = 0.01
# A row of cells with fewer returns than this share of those above and below is between beams.
_BETWEEN_SHARE: Final = 0.1


class RangeView:
    """The nearest return in each direction, ground included.

    What is seen at a flat angle, a wall along the way or the ground, is far apart from beam to
    beam: a place is free only if it is in front of the returns of neighbouring beams, too.

    Directions are in the axes of the beams: in those, the edges of what a tilted lidar sees are
    even.
    """

    def __init__(self, xyz: Floats32, beams_from_sensor: Floats = NOT_TILTED) -> None:
        """Makes the range image of points (N, 3), metres, sensor frame, of beams at (3, 3)."""
        self._beams_from_sensor = beams_from_sensor
        self._nearest = _nearest(*self._directions(xyz))
        self._nearest_around = _nearest_around(self._nearest)
        is_seen = np.isfinite(self._nearest).reshape(_NUM_ELEVATIONS, -1)
        self._above_or_below, self._between = _above_or_below(is_seen), _between(is_seen)
        self._beside = _beside(is_seen)

    def _directions(self, places: Floats32) -> tuple[Ints32, Floats32]:
        """Returns (P,) cell and range of places (P, 3), metres, sensor frame."""
        return _directions(in_axes_of_beams(places, self._beams_from_sensor))

    def are_free(self, positions: Floats32) -> Bools:
        """Returns (P,) which places (P, 3), metres, sensor frame, are known to be free.

        Directions without a return around say nothing.
        """
        cells, ranges = self._directions(positions)
        around = self._nearest_around[cells]
        return np.isfinite(around) & (around > ranges + _margins(ranges))

    def are_hidden(self, positions: Floats32) -> Bools:
        """Returns (P,) which places (P, 3), metres, sensor frame, are behind a surface."""
        cells, ranges = self._directions(positions)
        return self._nearest[cells] + _margins(ranges) < ranges

    def are_out(self, positions: Floats32, other: "RangeView") -> Bools:
        """Returns (P,) which places (P, 3) are out of view.

        They are above or below all beams, or at an azimuth from which nothing returns in both
        views.
        """
        cells, _ = self._directions(positions)
        beside = self._beside & other._beside
        return self._above_or_below[cells // NUM_AZIMUTHS] | beside[cells % NUM_AZIMUTHS]

    def limits_m(
        self, positions: Floats32, other: "RangeView", reach_m: float, hidden_m: float
    ) -> Floats32:
        """Returns (P,) metres, how far a point at a place may be from the nearest one of the sweep.

        Nobody can have seen places that are hidden or out of view. A place between the beams tells
        nothing: hardly anything returns from its elevation, all around, but much from above and
        below.

        Args:
            positions: (P, 3) metres, sensor frame.
            other: The view from which the points were seen.
            reach_m: The limit of other places.
            hidden_m: That of places that nobody can have seen; between the beams it is 0.
        """
        views = self._above_or_below, self._between, self._beside & other._beside
        limits = np.float32(reach_m), np.float32(hidden_m)
        return _limits(*self._directions(positions), self._nearest, *views, *limits)


def _beside(is_seen: Bools) -> Bools:
    """Returns (A,) from which azimuths, and those around, no cell (E, A) has a return."""
    azimuths = np.pad(is_seen.any(axis=0), _NUM_REACHED, mode="wrap")
    return np.asarray(~sliding_window_view(azimuths, 2 * _NUM_REACHED + 1).any(axis=1))


def _between(is_seen: Bools) -> Bools:
    """Returns (E,) which elevations are between the beams, by the cells (E, A) with a return."""
    counts = is_seen.sum(axis=1)
    sides = sliding_window_view(np.pad(counts, _NUM_REACHED), _NUM_REACHED).max(axis=1)
    below, above = sides[: len(counts)], sides[-len(counts) :]
    return np.asarray(counts < _BETWEEN_SHARE * np.minimum(below, above))


def _above_or_below(is_seen: Bools) -> Bools:
    """Returns (E,) which elevations are above or below all cells (E, A) with a return."""
    seen = np.flatnonzero(is_seen.any(axis=1))
    out = np.ones(len(is_seen), np.bool_)
    if len(seen):
        out[seen[0] : seen[-1] + 1] = False
    return out


def azimuths_of(xyz: Floats32) -> Ints32:
    """Returns (N,) the azimuth of points (N, 3), sensor frame, as a cell from 0 to 719."""
    return _directions(np.ascontiguousarray(xyz))[0] % NUM_AZIMUTHS


def in_axes_of_beams(xyz: Floats32, beams_from_sensor: Floats) -> Floats32:
    """Returns points (N, 3), sensor frame, in the axes of its beams, see `Sweep`."""
    if np.array_equal(beams_from_sensor, NOT_TILTED):
        return np.ascontiguousarray(xyz)
    return turned(xyz, beams_from_sensor)


@compiled("float32[::1](float32[::1])")
def _margins(ranges: Floats32) -> Floats32:
    """Returns (P,) metres, by how much places at ranges (P,) must be nearer than a return."""
    return np.float32(_MARGIN_M) + np.float32(_MARGIN_SHARE) * ranges


@compiled("float32(float32, float32)")
def _angle(rise: np.float32, run: np.float32) -> np.float32:
    """Returns arctan2(rise, run) in radians, to 2e-6: twice as fast as the exact one."""
    steep, flat = abs(rise), abs(run)
    is_steep = steep > flat
    longer, shorter = (steep, flat) if is_steep else (flat, steep)
    ratio = shorter / longer if longer > 0 else np.float32(0.0)
    square = ratio * ratio
    first, second, third, fourth, fifth, sixth = _ARCTAN
    angle = (((first * square + second) * square + third) * square + fourth) * square
    angle = ((angle + fifth) * square + sixth) * ratio
    angle = np.float32(np.pi / 2) - angle if is_steep else angle
    angle = np.float32(np.pi) - angle if run < 0 else angle
    return -angle if rise < 0 else angle


@compiled("Tuple((int32[::1], float32[::1]))(float32[:, ::1])")
def _directions(xyz: Floats32) -> tuple[Ints32, Floats32]:
    """Returns (N,) cell and range of points (N, 3)."""
    cells = np.empty(len(xyz), np.int32)
    ranges = np.empty(len(xyz), np.float32)
    # Of a flat array the compiler knows the steps: it looks at eight points at once.
    values = xyz.reshape(-1)
    for row in range(len(xyz)):
        x, y, z = values[3 * row], values[3 * row + 1], values[3 * row + 2]
        flat = np.sqrt(x * x + y * y)
        ranges[row] = np.sqrt(flat * flat + z * z)
        azimuth = (_angle(y, x) + np.float32(np.pi)) * np.float32(NUM_AZIMUTHS / (2 * np.pi))
        elevation = (_angle(z, flat) + np.float32(np.pi / 2)) * np.float32(_NUM_ELEVATIONS / np.pi)
        # What is not a number is in the last cell, too.
        is_across = (azimuth >= 0) & (azimuth < NUM_AZIMUTHS)
        is_up = (elevation >= 0) & (elevation < _NUM_ELEVATIONS)
        across = np.int32(azimuth) if is_across else np.int32(NUM_AZIMUTHS - 1)
        up = np.int32(elevation) if is_up else np.int32(_NUM_ELEVATIONS - 1)
        cells[row] = up * np.int32(NUM_AZIMUTHS) + across
    return cells, ranges


@compiled(
    "float32[::1](int32[::1], float32[::1], float32[::1], boolean[::1], boolean[::1], boolean[::1],"
    "float32, float32)"
)
def _limits(
    cells: Ints32,
    ranges: Floats32,
    nearest: Floats32,
    above_or_below: Bools,
    between: Bools,
    beside: Bools,
    reach_m: np.float32,
    hidden_m: np.float32,
) -> Floats32:
    """Loop of `RangeView.limits_m`."""
    margins = _margins(ranges)
    limits = np.empty(len(cells), np.float32)
    for row in range(len(cells)):
        cell = cells[row]
        up, across = cell // NUM_AZIMUTHS, cell % NUM_AZIMUTHS
        is_hidden = nearest[cell] + margins[row] < ranges[row]
        is_unseen = is_hidden or beside[across] or above_or_below[up]
        limits[row] = hidden_m if is_unseen else reach_m
        if between[up]:
            limits[row] = 0.0
    return limits


@compiled("float32[::1](int32[::1], float32[::1])")
def _nearest(cells: Ints32, ranges: Floats32) -> Floats32:
    """Returns (all cells,) the shortest of the ranges (N,) in each cell; infinity without one."""
    nearest = np.full(NUM_AZIMUTHS * _NUM_ELEVATIONS, np.inf, np.float32)
    for row in range(len(cells)):
        nearest[cells[row]] = min(nearest[cells[row]], ranges[row])
    return nearest


@compiled("float32[::1](float32[::1])")
def _nearest_around(nearest: Floats32) -> Floats32:
    """Returns (all cells,) the shortest range in each cell and in those beside, above and below.

    It is infinite where nothing returned from above or below: at the edge of what the sensor sees
    a place may lie beside all beams.
    """
    around = np.full(len(nearest), np.inf, np.float32)
    for up in range(_NUM_ELEVATIONS):
        row = up * NUM_AZIMUTHS
        for across in range(NUM_AZIMUTHS):
            cell = row + across
            left, right = row + (across - 1) % NUM_AZIMUTHS, row + (across + 1) % NUM_AZIMUTHS
            shortest = min(nearest[cell], nearest[left], nearest[right])
            num_sides = 0
            for side in (-1, 1):
                for step in range(1, _NUM_REACHED + 1):
                    other = cell + side * step * NUM_AZIMUTHS
                    if not 0 <= other < len(nearest):
                        break
                    if nearest[other] < np.inf:
                        shortest = min(shortest, nearest[other])
                        num_sides += 1
                        break
            if num_sides == 2:
                around[cell] = shortest
    return around
