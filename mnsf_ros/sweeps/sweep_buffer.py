# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The last few sweeps in stamp order, and whether one continues another."""

from collections import deque
from enum import Enum

from mnsf_ros.settings import BufferSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep, SweepTriplet


class Arrival(Enum):
    """How a sweep follows the last one: accepted, refused, or the start of a new buffer."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"  # same stamp as the last one: refused
    OUT_OF_ORDER = "out_of_order"  # a little older than the last one: refused
    TIME_WENT_BACK = "time_went_back"  # much older, as when a bag loops: buffer starts anew
    GAP = "gap"  # much newer: buffer starts anew
    FRAME_CHANGED = "frame_changed"  # other frame_id or mounting: buffer starts anew

    @classmethod
    def of(cls, sweep: Sweep, last: Sweep, max_gap_s: float, min_gap_s: float = 0.0) -> "Arrival":
        """How a sweep follows the last one, by their header stamps, frames and mountings only."""
        if sweep.frame_id != last.frame_id or sweep.tilt is not last.tilt:
            return cls.FRAME_CHANGED
        gap_s = (sweep.stamp_ns - last.stamp_ns) / NANOSECONDS
        if abs(gap_s) < min_gap_s:
            return cls.DUPLICATE
        if abs(gap_s) > max_gap_s:
            return cls.GAP if gap_s > 0 else cls.TIME_WENT_BACK
        return cls.OUT_OF_ORDER if gap_s < 0 else cls.ACCEPTED


REFUSED = frozenset({Arrival.DUPLICATE, Arrival.OUT_OF_ORDER})


class SweepBuffer:
    """Keeps the newest consecutive sweeps."""

    def __init__(self, num_kept: int = 3, num_needed: int = 3) -> None:
        """Starts empty; keeps `num_kept` sweeps at most. A triplet has `num_needed` at least.

        With 2 the previous sweep may be missing.
        """
        self._num_needed = num_needed
        self._sweeps: deque[Sweep] = deque(maxlen=max(num_kept, num_needed))

    def __len__(self) -> int:
        return len(self._sweeps)

    def clear(self) -> None:
        """Forgets all sweeps: no triplet spans this place."""
        self._sweeps.clear()

    def push(self, sweep: Sweep, settings: BufferSettings) -> tuple[Arrival, SweepTriplet | None]:
        """Adds the newest sweep, or refuses it. Returns which, and the triplet that it completes.

        The triplet's `earlier` has all other sweeps that are kept.
        """
        arrival = Arrival.ACCEPTED
        if self._sweeps:
            limits = settings.max_interval_s, settings.min_interval_s
            arrival = Arrival.of(sweep, self._sweeps[-1], *limits)
        if arrival in REFUSED:
            return arrival, None
        if arrival is not Arrival.ACCEPTED:
            self._sweeps.clear()
        self._sweeps.append(sweep)
        return arrival, self._triplet()

    def _triplet(self) -> SweepTriplet | None:
        if len(self._sweeps) < self._num_needed:
            return None
        newest, current, *before = reversed(self._sweeps)
        previous = before[0] if before else None
        return SweepTriplet(previous, current, newest, earlier=tuple(before[1:]))
