"""Where the sensor was at each sweep: by odometry where there is some, else by registration."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.ego_motion.pose_covariance import (
    StepNoise,
    chained_covariance,
    step_covariance,
    unknown_covariance,
)
from mnsf_ros.ego_motion.sweep_matcher import SweepMatcher
from mnsf_ros.geometry.transforms import interpolated_pose
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# So many times the last interval: farther ahead an extrapolation is no guess any more.
_MAX_INTERVALS: Final = 3.0
# Odometry that jumps farther than any robot drives, as after a reset, is no motion.
_MAX_SPEED_M_S: Final = 100.0
_MAX_STEP_M: Final = 1.0  # without stamps, too


class EgoSource(Enum):
    """What a pose was taken from."""

    START = "start"  # the first sweep: the origin of the world
    ODOMETRY = "odometry"
    REGISTRATION = "registration"
    CONSTANT_VELOCITY = "constant velocity"  # neither was there: the motion goes on as before


# Registration: 0.005 m and 0.5 mrad a sweep on KITTI 0005 and on an Apollo drive, 0.025 m where
# a simulated street is driven at 19 m/s. Odometry: a usual one; its own covariance is not read.
# Without either nobody knows.
_NOISE: Final = {
    EgoSource.START: StepNoise(0.001, 0.0, 0.0001, 0.0),
    EgoSource.REGISTRATION: StepNoise(0.006, 0.01, 0.0006, 0.01),
    EgoSource.ODOMETRY: StepNoise(0.01, 0.02, 0.001, 0.02),
    EgoSource.CONSTANT_VELOCITY: StepNoise(0.5, 0.5, 0.05, 0.5),
}


@dataclass(frozen=True, eq=False)
class SensorPose:
    """Where the sensor was when it took a sweep.

    Attributes:
        world_from_sensor: (4, 4) float64. The world is the sensor frame of the first sweep.
        source: What it was taken from.
        covariance: (6, 6) float64, of the pose, see `pose_covariance`; axes of the world.
        step_covariance: (6, 6) float64, of the motion since the sweep before; its axes.
    """

    world_from_sensor: NDArray[np.float64]
    source: EgoSource
    covariance: NDArray[np.float64] = field(default_factory=unknown_covariance)
    step_covariance: NDArray[np.float64] = field(default_factory=unknown_covariance)


class EgoMotion:
    """Chains the sensor's motion from sweep to sweep, so that a change of source is no jump."""

    def __init__(self, settings: EgoMotionSettings, num_threads: int = 1) -> None:
        self._settings = settings
        self._num_threads = num_threads
        self._matcher = self._new_matcher()
        self._pose: NDArray[np.float64] = np.eye(4)
        self._last: Sweep | None = None
        self._last_pose = _origin()
        self._last_motion: NDArray[np.float64] | None = None
        self._last_interval_ns = 0
        # Whether the last sweep is in the map: with odometry nobody needs one.
        self._is_mapped = False

    def use_threads(self, num_threads: int) -> None:
        """Sets the most threads that registration may use; poses do not depend on it."""
        self._num_threads = self._matcher.num_threads = num_threads

    def pose_of(self, sweep: Sweep) -> SensorPose:
        """The pose of a sweep that is newer than all before it.

        A sweep that is older, or of another frame, or comes after a long gap, starts a new world.
        The last sweep once more has the pose that it had.
        """
        if sweep is not self._last:
            is_start = self._is_new_start(sweep)
            self._last_pose = self._start(sweep) if is_start else self._next_pose(sweep)
        return self._last_pose

    def _next_pose(self, sweep: Sweep) -> SensorPose:
        motion, source = self._motion_to(sweep)
        if source is not EgoSource.CONSTANT_VELOCITY:
            last_ns = sweep.stamp_ns if self._last is None else self._last.stamp_ns
            self._last_motion, self._last_interval_ns = motion, sweep.stamp_ns - last_ns
        before, self._pose = self._pose, self._pose @ motion
        self._last = sweep
        step = step_covariance(motion, _NOISE[source])
        covariance = chained_covariance(self._last_pose.covariance, before, motion, step)
        return SensorPose(self._pose, source, covariance, step)

    def _is_new_start(self, sweep: Sweep) -> bool:
        last = self._last
        if last is None or sweep.frame_id != last.frame_id:
            return True
        elapsed_s = (sweep.stamp_ns - last.stamp_ns) / NANOSECONDS
        return elapsed_s < 0 or elapsed_s > self._settings.max_gap_s

    def _start(self, sweep: Sweep) -> SensorPose:
        self._last, self._pose, self._last_motion = sweep, np.eye(4), None
        self._matcher = self._new_matcher()
        self._is_mapped = not self._is_odometry_wanted or sweep.odometry is None
        if self._is_mapped:
            self._matcher.add(sweep.xyz, self._pose)
        return _origin()

    @property
    def _is_odometry_wanted(self) -> bool:
        return self._settings.source == "odometry"

    def _motion_to(self, sweep: Sweep) -> tuple[NDArray[np.float64], EgoSource]:
        """(4, 4) last_from_sweep, and where it is from."""
        before = None if self._last is None else self._last.odometry
        if self._is_odometry_wanted and before is not None and sweep.odometry is not None:
            motion: NDArray[np.float64] = np.linalg.inv(before) @ sweep.odometry
            if self._is_possible(motion, sweep):
                self._is_mapped = False
                return motion, EgoSource.ODOMETRY
        return self._registered(sweep)

    def _is_possible(self, motion: NDArray[np.float64], sweep: Sweep) -> bool:
        last_ns = sweep.stamp_ns if self._last is None else self._last.stamp_ns
        elapsed_s = (sweep.stamp_ns - last_ns) / NANOSECONDS
        longest_m = float(np.abs(motion[:3, 3]).max())
        return longest_m <= _MAX_STEP_M + _MAX_SPEED_M_S * elapsed_s

    def _registered(self, sweep: Sweep) -> tuple[NDArray[np.float64], EgoSource]:
        if not self._is_mapped and self._last is not None:
            # Odometry was lost just now: the map starts with the last sweep, where it was.
            self._matcher = self._new_matcher()
            self._matcher.add(self._last.xyz, self._pose)
        motion = self._expected_motion(sweep)
        pose = self._matcher.match(sweep.xyz, None if motion is None else self._pose @ motion)
        self._is_mapped = True
        if pose is None:
            motion = np.eye(4) if motion is None else motion
            # What the map shows is not what the sensor sees: it starts anew with this sweep, if
            # that shows anything at all.
            matcher = self._new_matcher()
            matcher.add(sweep.xyz, self._pose @ motion)
            self._matcher = self._matcher if matcher.is_empty else matcher
            return motion, EgoSource.CONSTANT_VELOCITY
        return np.linalg.inv(self._pose) @ pose, EgoSource.REGISTRATION

    def _expected_motion(self, sweep: Sweep) -> NDArray[np.float64] | None:
        """(4, 4) last_from_sweep if the sensor goes on with its velocity; None if there is none."""
        if self._last is None or self._last_motion is None:
            return None
        elapsed_ns, last_ns = sweep.stamp_ns - self._last.stamp_ns, self._last_interval_ns
        intervals = elapsed_ns / last_ns if elapsed_ns > 0 and last_ns > 0 else 1.0
        return interpolated_pose(np.eye(4), self._last_motion, min(intervals, _MAX_INTERVALS))

    def _new_matcher(self) -> SweepMatcher:
        return SweepMatcher(self._settings, self._num_threads)


def _origin() -> SensorPose:
    """The pose of the first sweep, which makes the world: certain, but not to the last digit."""
    covariance = step_covariance(np.eye(4), _NOISE[EgoSource.START])
    return SensorPose(np.eye(4), EgoSource.START, covariance, unknown_covariance())
