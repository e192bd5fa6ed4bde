# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Events and damage that are noticed while a recording is read."""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.recording.storage_file import Damage
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate

# Enough of a recording that is damaged from end to end.
_MAX_DAMAGES: Final = 100


class Event(str, Enum):
    """An event while a recording is read; its value is its text in `run.json` and in notes.

    The events of `Arrival` have the same names there.
    """

    SWEEPS_UNSTAMPED = "sweeps without a stamp; the time of reception was used"
    SWEEPS_TIMES_UNUSED = (
        "sweeps whose times per point cannot be read; they count as taken in one moment "
        "(time.field, time.unit)"
    )
    POINTS_UNTIMED = "points whose time cannot be right (lost packets?), left out"
    SWEEPS_WITHOUT_TRUTH = "sweeps without truth"
    SWEEPS_WITHOUT_POSE = "sweeps without odometry"
    DUPLICATE = "sweeps with the stamp of the previous sweep, skipped"
    OUT_OF_ORDER = "sweeps older than the previous sweep, skipped"
    TIME_WENT_BACK = "jumps back in time; no triplet spans them"
    GAP = "gaps in time; no triplet spans them"
    FRAME_CHANGED = "changes of frame_id; no triplet spans them"
    INTERRUPTIONS = "missing sweeps; no triplet spans the gap"
    TRUTH_WITHOUT_SWEEP = "truth clouds without a sweep"
    TRUTH_UNFIT = "truth clouds that do not match their sweep or cannot be read, not used"
    TRUTH_REORDERED = "truth clouds whose rows have another order, matched by position"
    TRUTH_ROWS_UNFIT = "points whose position is not in their truth, without truth"
    TRUTH_ROWS_COMPARED = "points of the sweeps with such points"
    PARTS = "clouds that are parts of a revolution, put together"
    LEVELLED = (
        "sweeps of a lidar that is tilted, upside down, or not at the origin; turned upright for "
        "methods (lidar_1.roll_deg, lidar_1.pitch_deg)"
    )
    SWEEPS_WITHOUT_RATES = (
        "sweeps without turn rates: those of the IMU have gaps, or stamps of another clock"
    )
    IMU_UNPLACED = (
        "sweeps whose IMU is not used: /tf_static does not connect its frame with that of clouds"
    )
    FRAMES_DIFFER = (
        "sweeps whose frame is not the odometry's child frame; set ego_motion.sensor_x_m to "
        "sensor_yaw_deg to where the sensor is mounted"
    )


@dataclass
class Findings:
    """Events and damage of one pass over a recording."""

    counts: Counter[Event] = field(default_factory=Counter)
    damages: dict[Damage, None] = field(default_factory=dict)  # unreadable parts, each once
    mounting: MountingEstimate = field(default_factory=MountingEstimate)
    input_check: InputCheck | None = None  # gets each cloud; None: the input is not checked

    def count(self, event: Event, times: int = 1) -> None:
        """Counts an event."""
        if times:
            self.counts[event] += times

    def report(self, damage: Damage) -> None:
        """Notes damage; several passes over a file find the same."""
        if len(self.damages) < _MAX_DAMAGES:
            self.damages.setdefault(damage)
