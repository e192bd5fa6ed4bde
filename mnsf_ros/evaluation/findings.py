"""What was noticed while a recording was read: counts of events, and damage."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

from mnsf_ros.recording.damage import Damage
from mnsf_ros.sweeps.sweep_buffer import Arrival

# A recording that is rubbish from end to end must not fill the memory with reports of it.
_MAX_DAMAGES: Final = 100

SWEEPS_READ = "sweeps read"
SWEEPS_UNSTAMPED = "sweeps without a stamp, for which the time of reception was taken"
SWEEPS_WITHOUT_TRUTH = "sweeps without truth"
SWEEPS_WITHOUT_POSE = "sweeps without odometry"
TRUTH_WITHOUT_SWEEP = "truth clouds without a sweep"
TRUTH_UNFIT = "truth clouds that do not fit their sweep, or cannot be read, and are not used"
FRAMES_DIFFER = (
    "sweeps in another frame than the odometry's child frame: where the sensor is in it is what "
    "ego_motion.sensor_x_m to sensor_yaw_deg tell"
)
ODOMETRY_CONTRADICTS = (
    "sweeps whose odometry contradicts the truth of what stands, so that methods which use it "
    "(ego) are wrong there"
)
INTERRUPTIONS = "holes, across which no triplet reaches"
# What the buffer of sweeps, the same as in the node, found odd about a sweep.
ARRIVALS: Final = {
    Arrival.DUPLICATE: "sweeps with the stamp of the one before, left out",
    Arrival.OUT_OF_ORDER: "sweeps older than the one before, left out",
    Arrival.TIME_WENT_BACK: "jumps back in time, across which no triplet reaches",
    Arrival.GAP: "gaps in time, across which no triplet reaches",
    Arrival.FRAME_CHANGED: "changes of frame_id, across which no triplet reaches",
}


@dataclass
class Findings:
    """What was noticed in one pass over a recording.

    Attributes:
        counts: Event to how often it happened.
        damages: What could not be read, each place once.
    """

    counts: Counter[str] = field(default_factory=Counter)
    damages: dict[Damage, None] = field(default_factory=dict)

    def count(self, event: str, times: int = 1) -> None:
        """Counts an event."""
        if times:
            self.counts[event] += times

    def report(self, damage: Damage) -> None:
        """Notes damage; several passes over a file find the same."""
        if len(self.damages) < _MAX_DAMAGES:
            self.damages.setdefault(damage)

    @property
    def warnings(self) -> dict[str, int]:
        """The counts that somebody should know of."""
        return {event: count for event, count in self.counts.items() if event != SWEEPS_READ}
