# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sensor poses of sweeps: from odometry if available, else by registration."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.covariance import (
    UNKNOWN_COVARIANCE,
    StepNoise,
    chained_covariance,
    six_axes,
    step_covariance,
)
from mnsf_ros.ego_motion.gyroscope import Gyroscope, fits
from mnsf_ros.ego_motion.sweep_matcher import KNOWN_VELOCITY, Placed, SweepMatcher
from mnsf_ros.ego_motion.sweep_motion import SweepMotion, Turns
from mnsf_ros.geometry.transforms import interpolated_pose
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep

# Longest extrapolation, in last intervals: beyond it, constant velocity is no useful guess.
_MAX_INTERVALS: Final = 3.0
# A longer jump of the odometry, as after a reset, is not taken as a motion.
_MAX_SPEED_M_S: Final = 100.0
_MAX_STEP_M: Final = 1.0  # without stamps, too
# Acceleration of vehicles (standard deviation). Vertically, robots with legs sway differently in
# each sweep.
_ACCELERATION_M_S2: Final = 2.0
_HEAVE_M: Final = 1.0
_LEAST_CHANGE_M: Final = 0.001  # of two sweeps of nearly the same time
# Maximum number of matches of a sweep, each with the motion found last.
_MAX_ROUNDS: Final = 3
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


@dataclass(frozen=True, eq=False)
class _Match:
    """A registered sweep.

    Attributes:
        found: Its pose.
        motion: (4, 4) last_from_sweep.
        cloud: Its points for the map.
        map: The map that it was matched with; the sweep is not in it yet.
        during: The motion during it; None if not known.
        bending: The motion expected during the next sweep; None if not used.
    """

    found: Placed
    motion: Floats
    cloud: Cloud | None
    map: SweepMatcher
    during: SweepMotion | None
    bending: SweepMotion | None


class EgoMotion:
    """Chains the ego motion from sweep to sweep, so that a change of source causes no jump."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._settings = settings
        # None with odometry, which needs no map. The map includes the last sweep.
        self._map: SweepMatcher | None = None
        self._last: Sweep | None = None
        self._last_pose = _origin()
        self._last_motion: Floats | None = None
        # Of that motion, from all sweeps so far, in world axes.
        self._last_covariance: Floats = np.zeros((6, 6))
        self._last_interval_ns = 0
        # The same for all sweeps of a world, so that intervals are those of the stamps.
        self._moment_s: float | None = None
        self._bending: SweepMotion | None = None  # expected
        self._during: SweepMotion | None = None  # the last sweep, if registered
        self._gyroscope = Gyroscope(is_used=settings.imu)
        self._turns: Turns | None = None  # of the last sweep

    def pose_of(self, sweep: Sweep) -> SensorPose:
        """The pose of a sweep newer than all before. The first sweep is the origin."""
        last, self._last, self._during = self._last, sweep, None
        self._last_pose = self._start(sweep) if last is None else self._next_pose(last, sweep)
        return self._last_pose

    def motion_in(self, sweep: Sweep) -> SweepMotion | None:
        """The sensor's motion during a sweep, as far as it is known by now."""
        if sweep.times_s is None or self._bending is None:
            return None
        if sweep is not self._last:
            return replace(self._bending, turns=None)
        return self._during or replace(self._bending, turns=self._turns)

    def _bent_by(self, sweep: Sweep, step: Floats, interval_ns: int) -> SweepMotion | None:
        """The motion during a sweep, given the motion `step` in an interval; None if not used."""
        if not self._settings.deskew or sweep.times_s is None or interval_ns <= 0:
            return None
        if self._moment_s is None:
            self._moment_s = sweep.middle_s
        motion = SweepMotion.of_step(step, interval_ns / NANOSECONDS, self._moment_s)
        variance = motion.variance if self._bending is None else self._bending.variance
        return replace(motion, turns=self._turns, variance=variance)

    def _start(self, sweep: Sweep) -> SensorPose:
        has_odometry = self._is_odometry_wanted and sweep.odometry is not None
        self._map = None if has_odometry else self._map_of(sweep, np.eye(4))
        return _origin()

    def _next_pose(self, last: Sweep, sweep: Sweep) -> SensorPose:
        before = self._last_pose.world_from_sensor
        interval_ns = sweep.stamp_ns - last.stamp_ns
        moment_s = self._moment_s or 0.0
        interval_s = moment_s - interval_ns / NANOSECONDS, moment_s
        self._turns = self._gyroscope.turns(sweep, moment_s)
        motion, source = self._odometry(last, sweep), EgoSource(self._settings.source)
        turn = self._gyroscope.turn(sweep, *interval_s)
        expected = self._expected(before, interval_ns, turn)
        known: Floats = np.zeros((6, 6))
        if motion is None:
            motion, source, known = self._registered(last, before, sweep, expected, turn)
        else:
            self._map = None
            self._bending = self._bent_by(sweep, motion, interval_ns)
        if source is not EgoSource.LOST:
            self._gyroscope.learn(sweep, *interval_s, motion[:3, :3])
        # From an unknown pose, the motion to the next one is unknown, too.
        was_guessed = self._last_pose.source is EgoSource.LOST
        if source is not EgoSource.LOST and not (was_guessed and self._last_motion is None):
            self._last_motion = None if interval_ns < 0 else motion
            self._last_interval_ns = interval_ns
            self._last_covariance = known + was_guessed * self._last_pose.step_covariance
        axes = six_axes(before[:3, :3])
        step = step_covariance(motion, _NOISE[source]) + axes.T @ known @ axes
        covariance = chained_covariance(self._last_pose.covariance, before, motion, step)
        lost = "the sweep does not match those before it" if source is EgoSource.LOST else ""
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
        self,
        last: Sweep,
        world_from_last: Floats,
        sweep: Sweep,
        expected: Placed | None,
        turn: Floats | None,
    ) -> tuple[Floats, EgoSource, Floats]:
        """(4, 4) last_from_sweep, its source, and its covariance (6, 6) by the map.

        If the measured turn does not fit, the sweep is registered without it.
        """
        if self._map is None:
            # Odometry was lost just now: the map starts with the last sweep at its pose.
            self._map = self._map_of(last, world_from_last, self.motion_in(last))
        match = self._matched(self._map, last, world_from_last, sweep, expected)
        turns = self._turns
        if turn is not None and not (match and fits(turn, match.motion[:3, :3])):
            self._turns = None
            guess = self._expected(world_from_last, sweep.stamp_ns - last.stamp_ns, None)
            match = self._matched(self._map, last, world_from_last, sweep, guess)
        if match is not None:
            self._map, self._during, self._bending = match.map, match.during, match.bending
            self._map.add(match.cloud, match.found)
            return match.motion, EgoSource.REGISTRATION, match.found.covariance
        self._turns = turns
        pose = world_from_last if expected is None else expected.pose
        # The sweep does not match the map: a new map starts with this sweep, unless it has too
        # few points.
        new_map = self._map_of(sweep, pose, self.motion_in(sweep))
        self._map = self._map if new_map.is_empty else new_map
        motion: Floats = np.linalg.inv(world_from_last) @ pose
        return motion, EgoSource.LOST, np.zeros((6, 6))

    def _matched(
        self,
        map_: SweepMatcher,
        last: Sweep,
        world_from_last: Floats,
        sweep: Sweep,
        expected: Placed | None,
    ) -> "_Match | None":
        """The pose of a sweep by the map, near an expected one; None if nothing fits.

        With times of points, an unexpected motion changes the correction for the motion during the
        sweep: the sweep is matched again with it.
        """
        interval_ns = sweep.stamp_ns - last.stamp_ns
        bending = self.motion_in(sweep)
        for _ in range(_MAX_ROUNDS):
            cloud = map_.prepared(sweep, bending)
            match = map_.match(cloud, expected)
            if match is None:
                return None
            found, during = match, None
            if bending is not None:
                axes = six_axes(found.pose[:3, :3])
                during = replace(bending, velocity=bending.velocity + axes.T @ found.velocity)
            motion = np.linalg.inv(world_from_last) @ found.pose
            refined = self._bent_by(sweep, motion, interval_ns)
            if refined is None or (bending is not None and refined.is_like(bending)):
                break
            if bending is None:
                # The map has the last sweep uncorrected, because its motion was unknown.
                map_ = self._map_of(last, world_from_last, refined)
            expected, bending = expected or Placed(found.pose), refined
        if refined is None:
            refined = self._bending
        elif bending is not None:
            refined = bending.towards(refined)
        return _Match(found, motion, cloud, map_, during, refined)

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
        motion = interpolated_pose(np.eye(4), self._last_motion, min(intervals, _MAX_INTERVALS))
        if turn is not None:
            motion = _turning_by(turn, motion)
        elapsed_s = elapsed_ns / NANOSECONDS if elapsed_ns > 0 else USUAL_INTERVAL_S
        axes = world_from_last[:3, :3]
        change_m = max(_ACCELERATION_M_S2 * elapsed_s**2, _LEAST_CHANGE_M)
        change = np.diag(np.square([change_m, change_m, _HEAVE_M]))
        covariance = intervals**2 * self._last_covariance
        covariance[:3, :3] += axes @ change @ axes.T
        pose = world_from_last @ motion
        return Placed(pose, covariance, velocity_covariance=self._velocity_covariance(pose))

    def _velocity_covariance(self, pose: Floats) -> Floats:
        """(6, 6) of the motion during a sweep at a pose, axes of the world; measured turns hold."""
        if self._bending is None:
            return KNOWN_VELOCITY
        variance = self._bending.variance * ([1.0] * 3 + [self._turns is None] * 3)
        axes = six_axes(pose[:3, :3])
        return np.asarray(KNOWN_VELOCITY + axes @ np.diag(variance) @ axes.T, np.float64)

    def _map_of(
        self, sweep: Sweep, pose: Floats, motion: SweepMotion | None = None
    ) -> SweepMatcher:
        matcher = SweepMatcher(self._settings)
        matcher.add(matcher.prepared(sweep, motion), Placed(pose))
        return matcher


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
