# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How the sensor moves during its sweeps, as far as that is known by now."""

from dataclasses import replace

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.ego_motion.covariance import six_axes
from mnsf_ros.ego_motion.sweep_matcher import KNOWN_VELOCITY
from mnsf_ros.ego_motion.sweep_motion import SweepMotion, Turns
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep


class Deskewing:
    """The motion during the newest sweep, and the one expected during the next.

    Attributes:
        newest: The newest sweep.
        expected: The motion expected during the next sweep; None if unknown, or not used.
        during: The motion during the newest sweep, if it was registered.
        turns: Measured rotations during the newest sweep, if there are any.
    """

    def __init__(self, *, is_used: bool) -> None:
        """Starts without any motion; not used, it never knows one."""
        self._is_used = is_used
        # The same for all sweeps of a world, so that intervals are those of the stamps.
        self._moment_s: float | None = None
        self.newest: Sweep | None = None
        self.expected: SweepMotion | None = None
        self.during: SweepMotion | None = None
        self.turns: Turns | None = None

    @property
    def moment_s(self) -> float:
        """Seconds from the stamp of a sweep to the moment that its points are corrected to."""
        return self._moment_s or 0.0

    def begin(self, sweep: Sweep) -> None:
        """Takes the newest sweep, whose motion is unknown yet."""
        self.newest, self.during = sweep, None

    def motion_in(self, sweep: Sweep) -> SweepMotion | None:
        """The sensor's motion during a sweep, as far as it is known by now."""
        if sweep.times_s is None or self.expected is None:
            return None
        if sweep is not self.newest:
            return replace(self.expected, turns=None)
        return self.during or replace(self.expected, turns=self.turns)

    def of_step(self, sweep: Sweep, step: Floats, interval_ns: int) -> SweepMotion | None:
        """The motion during a sweep by the step (4, 4) in an interval; None if not used."""
        if not self._is_used or sweep.times_s is None or interval_ns <= 0:
            return None
        if self._moment_s is None:
            self._moment_s = sweep.middle_s
        motion = SweepMotion.of_step(step, interval_ns / NANOSECONDS, self._moment_s)
        variance = motion.variance if self.expected is None else self.expected.variance
        return replace(motion, turns=self.turns, variance=variance)

    def velocity_covariance(self, pose: Floats) -> Floats:
        """(6, 6) of the motion during a sweep at a pose, axes of the world; measured turns hold."""
        if self.expected is None:
            return KNOWN_VELOCITY
        variance = self.expected.variance * ([1.0] * 3 + [self.turns is None] * 3)
        axes = six_axes(pose[:3, :3])
        return np.asarray(KNOWN_VELOCITY + axes @ np.diag(variance) @ axes.T, np.float64)
