"""The sensor's poses at the sweeps of triplets that follow each other."""

from __future__ import annotations

from itertools import pairwise

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource, SensorPose
from mnsf_ros.errors import SweepError
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet


class TripletPoses:
    """Finds the pose of each sweep once, though it is in several triplets."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._ego_motion = EgoMotion(settings)
        self._max_gap_s = settings.max_gap_s
        self._poses: dict[Sweep, SensorPose] = {}

    def use_threads(self, num_threads: int) -> None:
        """Sets the most threads that registration may use; poses do not depend on it."""
        self._ego_motion.use_threads(num_threads)

    def of(self, triplet: SweepTriplet) -> dict[Sweep, SensorPose]:
        """The poses of all sweeps of a triplet, in a world that they share.

        Raises:
            SweepError: If a sweep cannot follow the one before it: it is older, of another frame,
                or comes after too long a gap.
        """
        sweeps = (*reversed(triplet.before), triplet.current, triplet.next)
        known = [sweep in self._poses for sweep in sweeps]
        # A sweep that is older than a known one cannot be added to the chain: it starts anew.
        is_chain = known == sorted(known, reverse=True)
        poses = self._poses if is_chain else {}
        self._poses = {
            sweep: poses.get(sweep) or self._ego_motion.pose_of(sweep) for sweep in sweeps
        }
        for before, sweep in pairwise(sweeps):
            if self._poses[sweep].source is EgoSource.START:
                raise SweepError(
                    f"sweep {sweep.stamp_ns} ns of frame {sweep.frame_id!r} cannot follow sweep "
                    f"{before.stamp_ns} ns of frame {before.frame_id!r}: it has to be later, of "
                    f"the same frame, and within {self._max_gap_s:g} s (ego_motion.max_gap_s)"
                )
        return self._poses
