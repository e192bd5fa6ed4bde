"""The last three sweeps in stamp order."""

from __future__ import annotations

from collections import deque
from enum import Enum

from mnsf_ros.settings import BufferSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep, SweepTriplet


class Arrival(Enum):
    """What became of a sweep that was pushed into the buffer."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"  # same stamp as the last one: refused
    OUT_OF_ORDER = "out_of_order"  # a little older than the last one: refused
    TIME_WENT_BACK = "time_went_back"  # much older, as when a bag loops: buffer starts anew
    GAP = "gap"  # much newer: buffer starts anew
    FRAME_CHANGED = "frame_changed"  # other frame_id: buffer starts anew


_REFUSED = frozenset({Arrival.DUPLICATE, Arrival.OUT_OF_ORDER})
_RESTARTED = frozenset({Arrival.TIME_WENT_BACK, Arrival.GAP, Arrival.FRAME_CHANGED})


class SweepBuffer:
    """Keeps three consecutive sweeps; decides by their header stamps only."""

    def __init__(self) -> None:
        self._sweeps: deque[Sweep] = deque(maxlen=3)

    def push(self, sweep: Sweep, settings: BufferSettings) -> Arrival:
        """Adds a sweep, or refuses it, and says which.

        Args:
            sweep: The newest sweep.
            settings: What counts as a duplicate and as a gap.
        """
        arrival = self._classify(sweep, settings)
        if arrival in _RESTARTED:
            self._sweeps.clear()
        if arrival not in _REFUSED:
            self._sweeps.append(sweep)
        return arrival

    def triplet(self) -> SweepTriplet | None:
        """The three sweeps, or None while there are fewer."""
        if len(self._sweeps) < 3:
            return None
        previous, current, newest = self._sweeps
        return SweepTriplet(previous, current, newest)

    def _classify(self, sweep: Sweep, settings: BufferSettings) -> Arrival:
        if not self._sweeps:
            return Arrival.ACCEPTED
        newest = self._sweeps[-1]
        if sweep.frame_id != newest.frame_id:
            return Arrival.FRAME_CHANGED
        interval_s = (sweep.stamp_ns - newest.stamp_ns) / NANOSECONDS
        if abs(interval_s) < settings.min_interval_s:
            return Arrival.DUPLICATE
        if interval_s > settings.max_interval_s:
            return Arrival.GAP
        if interval_s < -settings.max_interval_s:
            return Arrival.TIME_WENT_BACK
        return Arrival.ACCEPTED if interval_s > 0 else Arrival.OUT_OF_ORDER
