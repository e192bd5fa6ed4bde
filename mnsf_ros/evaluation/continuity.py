"""Whether the sweeps of a recording fit their neighbours: by their stamps, and by their sizes.

Recordings without checksums can lose or change messages without any sign of damage.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_LONG: Final = 1.5  # usual intervals: from here on at least one sweep is missing
_FACTOR: Final = 2  # between the sizes of neighbours
_MIN_SWEEPS: Final = 5


class Continuity:
    """Collects stamps and sizes of the sweeps of a recording in the order of their stamps."""

    def __init__(self, max_interval_s: float) -> None:
        """Leaves longer intervals to those who count gaps."""
        self._max_interval_ns = max_interval_s * 1e9
        self._stamps: list[int] = []
        self._sizes: list[int] = []
        # Of the sweeps after which some are known to be missing.
        self._interrupted: list[int] = []

    def add(self, stamp_ns: int, num_points: int) -> None:
        """Adds the next sweep, with the number of points of its cloud."""
        self._stamps.append(stamp_ns)
        self._sizes.append(num_points)

    def interrupt(self) -> None:
        """Says that sweeps are known to be missing here."""
        self._interrupted.append(len(self._stamps) - 1)

    @property
    def num_missing(self) -> int:
        """Sweeps that are missing by the usual interval, the median, and were not known to be."""
        intervals = self._intervals()
        if len(intervals) < _MIN_SWEEPS:
            return 0
        usual = float(np.median(intervals))
        long = intervals[(intervals > _LONG * usual) & (intervals <= self._max_interval_ns)]
        return int(np.sum(np.round(long / usual) - 1)) if usual > 0 else 0

    @property
    def num_jumps(self) -> int:
        """Sweeps with less than half or more than twice the points of both neighbours."""
        sizes = np.array(self._sizes, np.float64)
        before, size, after = sizes[:-2], sizes[1:-1], sizes[2:]
        is_small = _FACTOR * size < np.minimum(before, after)
        is_large = size > _FACTOR * np.maximum(before, after)
        return int(np.count_nonzero(is_small | is_large))

    def _intervals(self) -> NDArray[np.int64]:
        """Nanoseconds between sweeps, without those where sweeps are known to be missing."""
        intervals = np.diff(np.array(self._stamps, np.int64))
        known = [row for row in self._interrupted if 0 <= row < len(intervals)]
        return np.delete(intervals, known)
