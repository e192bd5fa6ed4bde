# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The last few sweeps in stamp order."""

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


REFUSED = frozenset({Arrival.DUPLICATE, Arrival.OUT_OF_ORDER})
_RESTARTED = frozenset({Arrival.TIME_WENT_BACK, Arrival.GAP, Arrival.FRAME_CHANGED})


class SweepBuffer:
    """Keeps the newest consecutive sweeps; decides by their header stamps only."""

    def __init__(self, num_sweeps: int = 3) -> None:
        """Starts empty; keeps `num_sweeps` at most."""
        self._sweeps: deque[Sweep] = deque(maxlen=num_sweeps)

    def __len__(self) -> int:
        return len(self._sweeps)

    def clear(self) -> None:
        """Forgets all sweeps: no triplet spans this place."""
        self._sweeps.clear()

    def push(self, sweep: Sweep, settings: BufferSettings) -> Arrival:
        """Adds the newest sweep, or refuses it, and says which."""
        arrival = self._classify(sweep, settings)
        if arrival in _RESTARTED:
            self._sweeps.clear()
        if arrival not in REFUSED:
            self._sweeps.append(sweep)
        return arrival

    def triplet(self, num_sweeps: int = 3) -> SweepTriplet | None:
        """Returns the newest sweeps, or None while there are fewer than `num_sweeps`.

        With 2 the previous sweep may be missing. `earlier` has all others that are kept.
        """
        if len(self._sweeps) < num_sweeps:
            return None
        newest, current, *before = reversed(self._sweeps)
        previous = before[0] if before else None
        return SweepTriplet(previous, current, newest, earlier=tuple(before[1:]))

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
