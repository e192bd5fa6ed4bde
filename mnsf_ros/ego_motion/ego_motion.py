# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sensor poses of sweeps: from odometry if available, else by registration."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.ego_motion.covariance import (
    UNKNOWN_COVARIANCE,
    StepNoise,
    chained_covariance,
    six_axes,
    step_covariance,
)
from mnsf_ros.ego_motion.deskewed_match import Match, SweepPair
from mnsf_ros.ego_motion.deskewing import Deskewing
from mnsf_ros.ego_motion.gyroscope import Gyroscope, fits
from mnsf_ros.ego_motion.registration import Lost, Registration
from mnsf_ros.ego_motion.sweep_matcher import Placed
from mnsf_ros.ego_motion.sweep_motion import SweepMotion, Turns
from mnsf_ros.geometry.transforms import interpolated_pose
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep

# A longer jump of the odometry, as after a reset, is not taken as a motion.
_MAX_SPEED_M_S: Final = 100.0
_MAX_STEP_M: Final = 1.0  # without stamps, too
# Acceleration of vehicles (standard deviation). Vertically, robots with legs sway differently in
# each sweep.
_ACCELERATION_M_S2: Final = 2.0
_HEAVE_M: Final = 1.0
_LEAST_CHANGE_M: Final = 0.001  # of two sweeps of nearly the same time
# A driver that is stuck repeats its last cloud, or some clouds in turn.
_NUM_RECENT: Final = 4
_REPEATED: Final = "clouds repeat: the driver is stuck, or a simulation has no noise"
# Number of sweeps kept. Up to 22 Hz they reach back far enough for the sweep 0.6 s ago.
MAX_SWEEPS: Final = 12


class EgoSource(Enum):
    """Source of a pose."""

    START = "start"  # the first sweep: the origin of the world
    ODOMETRY = "odometry"
    TF = "tf"  # odometry, too, from the transforms between frames
    REGISTRATION = "registration"
    LOST = "lost"  # none is available, or believed: the last motion continues


# Registration: in addition to the covariance by the map; within a sweep vehicles sway on their
# springs. Odometry: typical values; its own covariance is not read. Without both: rough guesses.
_NOISE: Final = {
    EgoSource.START: StepNoise(0.001, 0.0, 0.0001, 0.0),
    EgoSource.REGISTRATION: StepNoise(0.002, 0.0, 0.001, 0.0),
    EgoSource.ODOMETRY: StepNoise(0.01, 0.02, 0.001, 0.02),
    EgoSource.TF: StepNoise(0.01, 0.02, 0.001, 0.02),
    EgoSource.LOST: StepNoise(0.5, 0.5, 0.05, 0.5),
}


@dataclass(frozen=True, eq=False)
class SensorPose:
    """Where the sensor was when it took a sweep.

    Attributes:
        world_from_sensor: (4, 4) float64, at the moment of `motion`. The world is the sensor frame
            of the first sweep.
        source: Source of the pose.
        lost: Why the pose is not known relative to the last one; empty if it is.
        motion: The sensor's motion during the sweep; None if the sweep counts as taken in one
            moment, at its stamp.
        covariance: Of the pose, in the axes of the world.
        step_covariance: Of the motion since the previous sweep, in the axes of that sweep.
    """

    world_from_sensor: Floats
    source: EgoSource
    covariance: Floats = field(default_factory=UNKNOWN_COVARIANCE.copy)
    step_covariance: Floats = field(default_factory=UNKNOWN_COVARIANCE.copy)
    motion: SweepMotion | None = None
    lost: str = ""

    @property
    def world_from_stamp(self) -> Floats:
        """(4, 4) where the sensor was at the stamp of the sweep."""
        if self.motion is None:
            return self.world_from_sensor
        return self.world_from_sensor @ self.motion.moment_from_stamp

    def in_one_moment(self, sweep: Sweep) -> Floats32:
        """Returns the points (N, 3) of this pose's sweep, corrected to the moment of `motion`."""
        if self.motion is None or sweep.times_s is None:
            return sweep.xyz
        return self.motion.moved(sweep.xyz, sweep.times_s)


class _Rotations(NamedTuple):
    """Measured rotations: during a sweep, and (3, 3) since the last one; None where unknown."""

    during: Turns | None
    since_last: Floats | None


# Of a motion that fits an earlier sweep, per step.
_FOUND_AGAIN: Final = np.diag(np.square([0.03] * 3 + [0.01] * 3))
_NOT_MEASURED: Final = _Rotations(None, None)


class EgoMotion:
    """Chains the ego motion from sweep to sweep, so that a change of source causes no jump."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._settings = settings
        self._deskewing = Deskewing(is_used=settings.deskew)
        self._registration = Registration(settings, self._deskewing)
        self._last: Sweep | None = None
        self._recent: deque[Sweep] = deque(maxlen=_NUM_RECENT)
        self._is_repeated = False
        self._last_pose = _origin()
        self._last_motion: Floats | None = None
        # Of that motion, from all sweeps so far, in world axes.
        self._last_covariance: Floats = np.zeros((6, 6))
        self._last_interval_ns = 0
        self._gyroscope = Gyroscope(is_used=settings.imu)

    def pose_of(self, sweep: Sweep) -> SensorPose:
        """The pose of a sweep newer than all before. The first sweep is the origin.

        A cloud that repeats an earlier one is no measurement: it counts as if it had not come.
        """
        was_repeated = self._is_repeated
        self._is_repeated = any(sweep.repeats(one) for one in self._recent)
        if self._is_repeated:
            return replace(self._last_pose, source=EgoSource.LOST, lost=_REPEATED)
        self._recent.append(sweep)
        last, self._last = self._last, sweep
        self._deskewing.begin(sweep)
        self._last_pose = self._start(sweep) if last is None else self._next_pose(last, sweep)
        if was_repeated:
            # The cloud before it is older than its stamp.
            return replace(self._last_pose, source=EgoSource.LOST, lost=_REPEATED)
        return self._last_pose

    def motion_in(self, sweep: Sweep) -> SweepMotion | None:
        """The sensor's motion during a sweep, as far as it is known by now."""
        return self._deskewing.motion_in(sweep)

    def _start(self, sweep: Sweep) -> SensorPose:
        if not (self._is_odometry_wanted and sweep.odometry is not None):
            self._registration.start(sweep, np.eye(4))
        return _origin()

    def _next_pose(self, last: Sweep, sweep: Sweep) -> SensorPose:
        before = self._last_pose.world_from_sensor
        interval_ns = sweep.stamp_ns - last.stamp_ns
        moment_s = self._deskewing.moment_s
        interval_s = moment_s - interval_ns / NANOSECONDS, moment_s
        measured = _Rotations(
            self._gyroscope.turns(sweep, moment_s), self._gyroscope.turn(sweep, *interval_s)
        )
        trusted = measured if self._gyroscope.is_good else _NOT_MEASURED
        self._deskewing.turns = trusted.during
        motion, source = self._odometry(last, sweep), EgoSource(self._settings.source)
        known: Floats = np.zeros((6, 6))
        lost, turned = "", motion
        if motion is None:
            found = self._registered(last, before, sweep, measured)
            if isinstance(found, Match):
                source, motion, known = EgoSource.REGISTRATION, found.motion, found.found.covariance
                self._deskewing.during, self._deskewing.expected = found.during, found.bending
                self._registration.accept(found, sweep)
                turned = motion
            else:
                source, lost, turned = EgoSource.LOST, found.reason, found.best
                motion = self._go_on(found, before, sweep, interval_ns, trusted.since_last)
        else:
            self._registration.stop()
            self._deskewing.expected = self._deskewing.of_step(sweep, motion, interval_ns)
        if turned is not None:
            self._gyroscope.learn(sweep, *interval_s, turned[:3, :3])
        # From an unknown pose, the motion to the next one is unknown, too.
        was_lost = self._last_pose.source is EgoSource.LOST
        if not lost and not (was_lost and self._last_motion is None):
            self._last_motion = None if interval_ns < 0 else motion
            self._last_interval_ns = interval_ns
            self._last_covariance = known + was_lost * self._last_pose.step_covariance
        axes = six_axes(before[:3, :3])
        step = step_covariance(motion, _NOISE[source]) + axes.T @ known @ axes
        covariance = chained_covariance(self._last_pose.covariance, before, motion, step)
        return SensorPose(before @ motion, source, covariance, step, self.motion_in(sweep), lost)

    @property
    def _is_odometry_wanted(self) -> bool:
        return self._settings.source != EgoSource.REGISTRATION.value

    def _odometry(self, last: Sweep, sweep: Sweep) -> Floats | None:
        """(4, 4) last_from_sweep; None if odometry is not used, missing or impossible."""
        if not self._is_odometry_wanted or last.odometry is None or sweep.odometry is None:
            return None
        motion: Floats = np.linalg.inv(last.odometry) @ sweep.odometry
        elapsed_s = (sweep.stamp_ns - last.stamp_ns) / NANOSECONDS
        is_possible = np.abs(motion[:3, 3]).max() <= _MAX_STEP_M + _MAX_SPEED_M_S * elapsed_s
        return motion if is_possible else None

    def _registered(
        self, last: Sweep, world_from_last: Floats, sweep: Sweep, measured: "_Rotations"
    ) -> Match | Lost:
        """A sweep registered with those before it.

        If the measured rotation does not fit, the sweep is registered without it. One that is not
        trusted yet is the last resort.
        """
        if not self._registration.is_started:
            # Odometry was lost just now: the map starts with the last sweep at its pose.
            self._registration.start(last, world_from_last)
        is_trusted = self._gyroscope.is_good
        failures: list[Lost] = []
        for rotations in (measured, _NOT_MEASURED) if is_trusted else (_NOT_MEASURED, measured):
            if failures and measured.since_last is None:
                break
            self._deskewing.turns, turn = rotations
            expected = self._expected(world_from_last, sweep.stamp_ns - last.stamp_ns, turn)
            found = self._registration.find(SweepPair(last, world_from_last, sweep, expected))
            if isinstance(found, Match):
                if turn is None or fits(turn, found.motion[:3, :3]):
                    return found
                found = Lost("turn rates contradict the clouds", found.motion)
            failures.append(found)
        self._deskewing.turns = measured.during if is_trusted else None
        return failures[0]

    def _go_on(
        self,
        lost: Lost,
        world_from_last: Floats,
        sweep: Sweep,
        interval_ns: int,
        turn: Floats | None,
    ) -> Floats:
        """Begins anew after a sweep is lost; (4, 4) last_from_sweep, a guess.

        By an earlier sweep, else as if the last motion continued, else without motion.
        """
        if lost.again is not None:
            self._last_motion, self._last_interval_ns = lost.again.step, interval_ns
            self._last_covariance = _FOUND_AGAIN
            self._registration.start_again(sweep, lost.again)
            pose = lost.again.pose
        else:
            expected = self._expected(world_from_last, interval_ns, turn)
            pose = world_from_last if expected is None else expected.pose
            self._registration.start(sweep, pose)
        return np.asarray(np.linalg.inv(world_from_last) @ pose, np.float64)

    def _expected(
        self, world_from_last: Floats, elapsed_ns: int, turn: Floats | None
    ) -> Placed | None:
        """The pose at constant velocity and a measured turn (3, 3) or, without, constant turn rate.

        None if the velocity or the time is unknown.
        """
        if self._last_motion is None or elapsed_ns < 0:
            return None
        last_ns = self._last_interval_ns
        intervals = elapsed_ns / last_ns if elapsed_ns > 0 and last_ns > 0 else 1.0
        motion = interpolated_pose(np.eye(4), self._last_motion, intervals)
        if turn is not None:
            motion = _turning_by(turn, motion)
        elapsed_s = elapsed_ns / NANOSECONDS if elapsed_ns > 0 else USUAL_INTERVAL_S
        axes = world_from_last[:3, :3]
        change_m = max(_ACCELERATION_M_S2 * elapsed_s**2, _LEAST_CHANGE_M)
        change = np.diag(np.square([change_m, change_m, _HEAVE_M]))
        covariance = intervals**2 * self._last_covariance
        covariance[:3, :3] += axes @ change @ axes.T
        pose = world_from_last @ motion
        return Placed(
            pose, covariance, velocity_covariance=self._deskewing.velocity_covariance(pose)
        )


class SensorPoses:
    """The sensor's poses at the last sweeps of a stream, each found once."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._ego_motion = EgoMotion(settings)
        self._poses: dict[Sweep, SensorPose] = {}

    def of(self, sweeps: Iterable[Sweep]) -> dict[Sweep, SensorPose]:
        """The poses of sweeps, oldest first, in one common frame, the world.

        Each sweep is newer than all earlier ones, or one of them.
        """
        found = {}
        for sweep in sweeps:
            found[sweep] = self._poses.get(sweep) or self._ego_motion.pose_of(sweep)
        self._poses |= found
        for sweep in list(self._poses)[:-MAX_SWEEPS]:
            del self._poses[sweep]
        return found

    def motion_in(self, sweep: Sweep) -> SweepMotion | None:
        """The sensor's motion during a sweep, as far as it is known by now."""
        return self._ego_motion.motion_in(sweep)


def _turning_by(turn: Floats, motion: Floats) -> Floats:
    """The motion (4, 4) with another rotation (3, 3), and the same velocity along own axes."""
    velocity = SweepMotion.of_step(motion, 1.0, 0.0).velocity[:3]
    half = Rotation.from_rotvec(Rotation.from_matrix(turn).as_rotvec() / 2)
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turn, half.apply(velocity)
    return result


def _origin() -> SensorPose:
    """The pose of the first sweep, the origin of the world, with a tiny covariance."""
    covariance = step_covariance(np.eye(4), _NOISE[EgoSource.START])
    return SensorPose(np.eye(4), EgoSource.START, covariance)
