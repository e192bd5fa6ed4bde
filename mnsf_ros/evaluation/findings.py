# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Findings of a pass over a recording: counts of events, and damage."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np

from mnsf_ros.recording.storage_file import Damage
from mnsf_ros.sweeps.sweep import NANOSECONDS
from mnsf_ros.sweeps.sweep_buffer import Arrival

# Enough of a recording that is damaged from end to end.
_MAX_DAMAGES: Final = 100


class Event(str, Enum):
    """An event that is counted while a recording is read, as `tasks.jsonl` and notes name it."""

    SWEEPS_UNSTAMPED = "sweeps without a stamp; the time of reception was used"
    SWEEPS_TIMES_UNUSED = (
        "sweeps whose times per point cannot be read; they count as taken in one moment "
        "(time.field, time.unit)"
    )
    SWEEPS_WITHOUT_TRUTH = "sweeps without truth"
    SWEEPS_WITHOUT_POSE = "sweeps without odometry"
    SWEEPS_DUPLICATE = "sweeps with the stamp of the previous sweep, skipped"
    SWEEPS_OUT_OF_ORDER = "sweeps older than the previous sweep, skipped"
    JUMPS_BACK = "jumps back in time; no triplet spans them"
    GAPS = "gaps in time; no triplet spans them"
    FRAME_CHANGES = "changes of frame_id; no triplet spans them"
    INTERRUPTIONS = "missing sweeps; no triplet spans the gap"
    SWEEPS_MISSING = "sweeps missing by the stamps of their neighbours, without damage found there"
    TRUTH_WITHOUT_SWEEP = "truth clouds without a sweep"
    TRUTH_UNFIT = "truth clouds that do not match their sweep or cannot be read, not used"
    FRAMES_DIFFER = (
        "sweeps whose frame is not the odometry's child frame; set ego_motion.sensor_x_m to "
        "sensor_yaw_deg to where the sensor is mounted"
    )


# Arrivals at the sweep buffer that are counted.
ARRIVAL_EVENTS: Final = {
    Arrival.DUPLICATE: Event.SWEEPS_DUPLICATE,
    Arrival.OUT_OF_ORDER: Event.SWEEPS_OUT_OF_ORDER,
    Arrival.TIME_WENT_BACK: Event.JUMPS_BACK,
    Arrival.GAP: Event.GAPS,
    Arrival.FRAME_CHANGED: Event.FRAME_CHANGES,
}


@dataclass
class Findings:
    """Counts and damage of one pass over a recording.

    Attributes:
        counts: Event to number of occurrences.
        damages: Unreadable parts, each place once.
    """

    counts: Counter[Event] = field(default_factory=Counter)
    damages: dict[Damage, None] = field(default_factory=dict)

    def count(self, event: Event, times: int = 1) -> None:
        """Counts an event."""
        if times:
            self.counts[event] += times

    def report(self, damage: Damage) -> None:
        """Notes damage; several passes over a file find the same."""
        if len(self.damages) < _MAX_DAMAGES:
            self.damages.setdefault(damage)


_LONG: Final = 1.5  # usual intervals: from here on at least one sweep is missing
_MIN_INTERVALS: Final = 5


def num_missing(stamps_ns: list[int], breaks: list[int], max_interval_s: float) -> int:
    """Returns how many sweeps are missing by the median interval between stamps.

    Recordings without checksums can lose messages without any sign of damage. Intervals after the
    sweeps `breaks`, where others are known to be missing, do not count, nor longer ones than
    `max_interval_s`, which are counted as gaps.
    """
    intervals = np.diff(np.array(stamps_ns, np.int64))
    intervals = np.delete(intervals, [row for row in breaks if 0 <= row < len(intervals)])
    if len(intervals) < _MIN_INTERVALS:
        return 0
    usual = float(np.median(intervals))
    long = intervals[(intervals > _LONG * usual) & (intervals <= max_interval_s * NANOSECONDS)]
    return int(np.sum(np.round(long / usual) - 1)) if usual > 0 else 0
