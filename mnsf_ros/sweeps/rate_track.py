# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recent turn rates of a gyroscope, and those around a sweep."""

from collections.abc import Iterable
from itertools import takewhile
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.geometry.stamped_rate import StampedRate
from mnsf_ros.geometry.stamped_track import StampedTrack
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

_MAX_RATES: Final = 4000
# As long as no method bridges, and no lidar takes for a sweep.
_BEFORE_NS: Final = NANOSECONDS
# Between rates farther apart, and so long after the last one, the rotation is unknown: a robot that
# begins to turn with 3 rad/s² would be 0.2 degrees off.
MAX_GAP_S: Final = 0.05


class RateTrack(StampedTrack[StampedRate]):
    """The last 4000 turn rates of one IMU."""

    def __init__(self, recorded: Iterable[StampedRate | None] = ()) -> None:
        """Starts without rates; recorded ones are read on the way, None where some are missing."""
        super().__init__(recorded, _MAX_RATES)

    @property
    def rate_hz(self) -> float:
        """Mean number of rates a second, in the last second of them; 0 if unknown."""
        if len(self._items) < 2:
            return 0.0
        last_ns = self._items[-1].stamp_ns
        own = takewhile(lambda item: item.stamp_ns >= last_ns - NANOSECONDS, reversed(self._items))
        stamps_ns = [item.stamp_ns for item in own]
        if len(stamps_ns) < 2:
            stamps_ns.append(self._items[-2].stamp_ns)
        return (len(stamps_ns) - 1) * NANOSECONDS / (last_ns - stamps_ns[-1])

    @property
    def frame_id(self) -> str:
        """Frame of the rates; empty without any."""
        return self._items[-1].frame_id if self._items else ""

    def add(self, item: StampedRate) -> bool:
        """Adds rates, see `StampedTrack.add`. Those of another frame replace all before."""
        if item.frame_id != self.frame_id:
            self._items.clear()
        return super().add(item)

    def around(self, sweep: Sweep) -> Floats:
        """Returns the rates from a second before the stamp of a sweep to its last point.

        They are (K, 4), K may be 0: seconds from the stamp, and rad/s about the axes of the IMU.
        One more row may be after the last point.
        """
        stamp_ns = sweep.stamp_ns
        first_ns, end_ns = stamp_ns - _BEFORE_NS, stamp_ns + round(sweep.span_s[1] * NANOSECONDS)
        self.read_until(end_ns)
        rows = []
        for item in self._items:
            if item.stamp_ns >= first_ns:
                rows.append(((item.stamp_ns - stamp_ns) / NANOSECONDS, *item.rate))
                if item.stamp_ns >= end_ns:
                    break
        return np.array(rows, dtype=np.float64).reshape(-1, 4)


def are_covered(rates: Floats, first_s: float, last_s: float) -> bool:
    """Returns whether rates (K, 4), as of `RateTrack.around`, tell the rotation between times."""
    times_s = rates[:, 0]
    begin, end = np.searchsorted(times_s, first_s, "right") - 1, np.searchsorted(times_s, last_s)
    if begin < 0:
        return False
    # The last gap is below 0 if rates come after the last time.
    gaps_s = np.diff(np.append(times_s[begin : end + 1], last_s))
    return bool(gaps_s.max() <= MAX_GAP_S)
