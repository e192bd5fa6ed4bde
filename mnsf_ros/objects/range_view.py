# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Range image of a sweep: which places it saw to be free."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled

# Cells span a few beams of common sensors. Those above and below that are empty, as between few
# beams, are passed over, up to this far.
_AZIMUTH_DEG: Final = 0.5
_ELEVATION_DEG: Final = 1.0
_REACH_DEG: Final = 3.0
_NUM_AZIMUTHS: Final = round(360 / _AZIMUTH_DEG)
_NUM_ELEVATIONS: Final = round(180 / _ELEVATION_DEG)
_NUM_REACHED: Final = round(_REACH_DEG / _ELEVATION_DEG)
_AZIMUTHS_PER_RAD: Final = np.float32(180 / np.pi / _AZIMUTH_DEG)
_ELEVATIONS_PER_RAD: Final = np.float32(180 / np.pi / _ELEVATION_DEG)
# Of the odd polynomial that is nearest to the arctangent from 0 to 1, highest power first.
_ARCTAN: Final = tuple(
    map(np.float32, (-0.011719, 0.052647, -0.116426, 0.19354, -0.332623, 0.999977))
)
# A place is free only if it is nearer than what is around by this plus this share of its range.
_MARGIN_M: Final = 0.2
_MARGIN_SHARE: Final = 0.01


class RangeView:
    """The nearest return in each direction, ground included.

    What is seen at a flat angle, a wall along the way or the ground, is far apart from beam to
    beam: a place is free only if it is in front of the returns of neighbouring beams, too.
    """

    def __init__(self, xyz: NDArray[np.float32]) -> None:
        """Makes the range image of points (N, 3), in metres in the frame of the sensor."""
        self._nearest = _nearest(*_directions(np.ascontiguousarray(xyz)))
        self._nearest_around = _nearest_around(self._nearest)

    def are_free(self, positions: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns (P,) which places (P, 3), metres, sensor frame, are known to be free.

        Directions without a return around say nothing.
        """
        cells, ranges = _directions(np.ascontiguousarray(positions))
        around = self._nearest_around[cells]
        return np.isfinite(around) & (around > ranges + _margins(ranges))

    def are_hidden(
        self,
        positions: NDArray[np.float32],
        own_ranges: NDArray[np.float32] | None = None,
        own_reach_m: float = 0.0,
    ) -> NDArray[np.bool_]:
        """Returns (P,) which places are behind a surface.

        Args:
            positions: (P, 3) metres, sensor frame.
            own_ranges: (P,) metres, of surfaces that do not count.
            own_reach_m: How far from those a return is one of theirs.
        """
        cells, ranges = _directions(np.ascontiguousarray(positions))
        nearest = self._nearest[cells]
        is_hidden = nearest + _margins(ranges) < ranges
        if own_ranges is not None:
            is_hidden &= np.abs(nearest - own_ranges) > own_reach_m
        return is_hidden


def _margins(ranges: NDArray[np.float32]) -> NDArray[np.float32]:
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
def _directions(xyz: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Returns (N,) cell and range of points (N, 3)."""
    cells = np.empty(len(xyz), np.int32)
    ranges = np.empty(len(xyz), np.float32)
    # Of a flat array the compiler knows the steps: it looks at eight points at once.
    values = xyz.reshape(-1)
    for row in range(len(xyz)):
        x, y, z = values[3 * row], values[3 * row + 1], values[3 * row + 2]
        flat = np.sqrt(x * x + y * y)
        ranges[row] = np.sqrt(flat * flat + z * z)
        azimuth = (_angle(y, x) + np.float32(np.pi)) * _AZIMUTHS_PER_RAD
        elevation = (_angle(z, flat) + np.float32(np.pi / 2)) * _ELEVATIONS_PER_RAD
        # What is not a number is in the last cell, too.
        is_across = (azimuth >= 0) & (azimuth < _NUM_AZIMUTHS)
        is_up = (elevation >= 0) & (elevation < _NUM_ELEVATIONS)
        across = np.int32(azimuth) if is_across else np.int32(_NUM_AZIMUTHS - 1)
        up = np.int32(elevation) if is_up else np.int32(_NUM_ELEVATIONS - 1)
        cells[row] = up * np.int32(_NUM_AZIMUTHS) + across
    return cells, ranges


@compiled("float32[::1](int32[::1], float32[::1])")
def _nearest(cells: NDArray[np.int32], ranges: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (all cells,) the shortest of the ranges (N,) in each cell; infinity without one."""
    nearest = np.full(_NUM_AZIMUTHS * _NUM_ELEVATIONS, np.inf, np.float32)
    for row in range(len(cells)):
        nearest[cells[row]] = min(nearest[cells[row]], ranges[row])
    return nearest


@compiled("float32[::1](float32[::1])")
def _nearest_around(nearest: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (all cells,) the shortest range in each cell and in those beside, above and below.

    It is infinite where nothing returned from above or below: at the edge of what the sensor sees
    a place may lie beside all beams.
    """
    around = np.full(len(nearest), np.inf, np.float32)
    for up in range(_NUM_ELEVATIONS):
        row = up * _NUM_AZIMUTHS
        for across in range(_NUM_AZIMUTHS):
            cell = row + across
            left, right = row + (across - 1) % _NUM_AZIMUTHS, row + (across + 1) % _NUM_AZIMUTHS
            shortest = min(nearest[cell], nearest[left], nearest[right])
            num_sides = 0
            for side in (-1, 1):
                for step in range(1, _NUM_REACHED + 1):
                    other = cell + side * step * _NUM_AZIMUTHS
                    if not 0 <= other < len(nearest):
                        break
                    if nearest[other] < np.inf:
                        shortest = min(shortest, nearest[other])
                        num_sides += 1
                        break
            if num_sides == 2:
                around[cell] = shortest
    return around
