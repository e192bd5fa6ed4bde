"""Range image of a sweep: which places it saw to be free."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Cells span a few beams of common sensors. Empty cells, as with few beams, are not free.
_AZIMUTH_DEG: Final = 0.5
_ELEVATION_DEG: Final = 1.0
_NUM_AZIMUTHS: Final = round(360 / _AZIMUTH_DEG)
_NUM_ELEVATIONS: Final = round(180 / _ELEVATION_DEG)
# A place is free only if it is nearer than the surface by this plus this share of its range.
_MARGIN_M: Final = 0.2
_MARGIN_SHARE: Final = 0.01


class RangeView:
    """The nearest return in each direction, ground included."""

    def __init__(self, xyz: NDArray[np.float32]) -> None:
        """Makes the range image of points (N, 3), in metres in the frame of the sensor."""
        cells, ranges = _directions(xyz)
        self._nearest = np.full(_NUM_AZIMUTHS * _NUM_ELEVATIONS, np.inf, np.float32)
        # Points come in the order of the beams: first the nearest of each run in one cell.
        starts = np.flatnonzero(np.diff(cells, prepend=-1))
        if len(starts):
            np.minimum.at(self._nearest, cells[starts], np.minimum.reduceat(ranges, starts))

    def is_free(self, positions: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns (P,) whether places (P, 3), in metres in the frame of the sweep, are free.

        Places behind a surface, and directions without a return, are not known to be free.
        """
        nearest, ranges, margin = self._compared(positions)
        is_free: NDArray[np.bool_] = np.isfinite(nearest) & (nearest > ranges + margin)
        return is_free

    def is_hidden(self, positions: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns (P,) whether places (P, 3), in metres in the frame, are behind a surface."""
        nearest, ranges, margin = self._compared(positions)
        is_hidden: NDArray[np.bool_] = nearest < ranges - margin
        return is_hidden

    def _compared(self, positions: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
        """Returns (P,) nearest return in the direction of each place, its range, and a margin."""
        cells, ranges = _directions(positions)
        margin = np.float32(_MARGIN_M) + np.float32(_MARGIN_SHARE) * ranges
        return self._nearest[cells], ranges, margin


def _directions(xyz: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Returns (N,) cell and range of points (N, 3)."""
    x, y, z = (np.ascontiguousarray(xyz[:, axis]) for axis in range(3))
    with np.errstate(over="ignore"):  # overflow to infinity is far away, too
        flat = np.sqrt(x * x + y * y)
        ranges = np.sqrt(flat * flat + z * z)
    columns = _cells(np.arctan2(y, x), np.pi, _AZIMUTH_DEG, _NUM_AZIMUTHS)
    rows = _cells(np.arctan2(z, flat), np.pi / 2, _ELEVATION_DEG, _NUM_ELEVATIONS)
    return rows * _NUM_AZIMUTHS + columns, ranges


def _cells(
    angles: NDArray[np.float32], half: float, size_deg: float, number: int
) -> NDArray[np.int32]:
    """Returns (N,) cells of angles (N,) from -`half` to `half` in radians."""
    scaled = (angles + np.float32(half)) * np.float32(180 / np.pi / size_deg)
    return np.minimum(scaled.astype(np.int32), number - 1)
