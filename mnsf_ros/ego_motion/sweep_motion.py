# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The sensor's motion during a sweep, and the correction of points to one moment."""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.compiled import compiled

# Along x, y and z, and about them. A vehicle pitches, rolls and heaves on its springs, and a robot
# with legs at each step: in these axes the last interval predicts little of the next one, and the
# motion during each sweep is registered.
_SWAYS: Final = np.array([False, False, True, True, True, False])
# Gains for a new motion, and for the variance of new motions.
_GAINS: Final = np.where(_SWAYS, 0.1, 0.5)
_VARIANCE_GAIN: Final = 0.5
# Motions are alike if, within `_WITHIN_S`, they move points at `_FAR_M` by less than
# `_MAX_DIFFERENCE_M` differently.
_WITHIN_S: Final = 0.1
_FAR_M: Final = 30.0
_MAX_DIFFERENCE_M: Final = 0.2
# Rotations in the table of a sweep.
NUM_TURNS: Final = 33


@dataclass(frozen=True, eq=False)
class Turns:
    """Measured rotations of the sensor during a sweep.

    Attributes:
        first_s: Seconds from the stamp to the first rotation; the others follow at even times.
        last_s: Seconds to the last one.
        table: (K, 3, 3) float64, each moment_from_sensor.
        moment_from_stamp: (3, 3) float64, that of the stamp.
    """

    first_s: float
    last_s: float
    table: Floats
    moment_from_stamp: Floats

    @classmethod
    def steady(cls, rate: Floats, moment_s: float, times_s: Floats32) -> "Turns":
        """Returns the rotations at a constant rate (3,), rad/s, in the span of some times (N,)."""
        first_s, last_s = (float(end(times_s, initial=moment_s)) for end in (np.min, np.max))
        elapsed_s = np.append(np.linspace(first_s, last_s, NUM_TURNS), 0.0) - moment_s
        turns = Rotation.from_rotvec(elapsed_s[:, None] * rate).as_matrix()
        return cls(first_s, last_s, turns[:-1], turns[-1])


@dataclass(frozen=True, eq=False)
class SweepMotion:
    """Motion of constant velocity and, where rotations are not measured, turn rate.

    Attributes:
        velocity: (6,) float64 along x, y and z of the sensor in m/s, then about them in rad/s.
        moment_s: Seconds from the stamp of the sweep to the moment that points are corrected to.
        turns: The measured rotations; None if there are none.
        variance: (6,) of the velocity, by how the last motions differed; 0 in the axes along which
            the sensor does not sway.
    """

    velocity: Floats
    moment_s: float
    turns: Turns | None = None
    variance: Floats = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def of_step(cls, step: Floats, interval_s: float, moment_s: float) -> "SweepMotion":
        """Returns the motion of a step before_from_after (4, 4) within an interval above 0."""
        turn = Rotation.from_matrix(step[:3, :3]).as_rotvec()
        # The step is in the axes of its beginning; in a bend the sensor moves along those of the
        # middle.
        shift = Rotation.from_rotvec(-turn / 2).apply(step[:3, 3])
        return cls(np.concatenate([shift, turn]) / interval_s, moment_s)

    @property
    def moment_from_stamp(self) -> Floats:
        """(4, 4) pose of the sensor at the stamp, in its frame at the moment."""
        pose = np.eye(4)
        pose[:3, :3] = self._turns_at(np.zeros(1, np.float32)).moment_from_stamp
        pose[:3, 3] = -self.moment_s * self.velocity[:3]
        return pose

    def is_like(self, other: "SweepMotion") -> bool:
        """Whether two motions move the points of a sweep to about the same places."""
        difference = _GAINS / _GAINS.max() * (self.velocity - other.velocity) * _WITHIN_S
        shift_m, turn_rad = np.linalg.norm(difference[:3]), np.linalg.norm(difference[3:])
        if self.turns is not None and other.turns is not None:
            turn_rad = np.float64(0.0)
        return bool(shift_m + _FAR_M * turn_rad < _MAX_DIFFERENCE_M)

    def towards(self, newer: "SweepMotion") -> "SweepMotion":
        """Returns a weighted mean with a newer motion, so that noise does not distort sweeps."""
        change = newer.velocity - self.velocity
        variance = self.variance + _VARIANCE_GAIN * (_SWAYS * change**2 - self.variance)
        return replace(newer, velocity=self.velocity + _GAINS * change, variance=variance)

    def moved(self, xyz: Floats32, times_s: Floats32) -> Floats32:
        """Returns static points as seen at the moment.

        Args:
            xyz: (N, 3) metres, each in the frame of the sensor when it measured the point.
            times_s: (N,) seconds from the stamp to that.

        Returns:
            (N, 3) metres, frame of the sensor at the moment.
        """
        return self._moved(xyz, times_s, self.velocity[:3])

    def moved_back(self, xyz: Floats32, times_s: Floats32) -> Floats32:
        """Returns static points (N, 3) of the moment as the sensor sees them at `times_s` (N,)."""
        return self._moved(xyz, times_s, self.velocity[:3], back=True)

    def turned_back(self, vectors: Floats32, times_s: Floats32) -> Floats32:
        """Returns vectors (N, 3), given in axes of the moment, in sensor axes at `times_s` (N,)."""
        return self._moved(vectors, times_s, np.zeros(3), back=True)

    def _moved(
        self, vectors: Floats32, times_s: Floats32, velocity: Floats, *, back: bool = False
    ) -> Floats32:
        turns = self._turns_at(times_s)
        table = turns.table.transpose(0, 2, 1) if back else turns.table
        span = turns.first_s, turns.last_s, self.moment_s
        rotations = np.ascontiguousarray(table, np.float32)
        return _moved_by(vectors, times_s, *span, rotations, velocity.astype(np.float32), back)

    def _turns_at(self, times_s: Floats32) -> Turns:
        """The measured rotations, else those of a constant rate at the times (N,)."""
        return self.turns or Turns.steady(self.velocity[3:], self.moment_s, times_s)


@compiled(
    "float32[:, ::1](float32[:, :], float32[:], float64, float64, float64, float32[:, :, ::1],"
    " float32[::1], boolean)"
)
def _moved_by(
    vectors: Floats32,
    times_s: Floats32,
    first_s: float,
    last_s: float,
    moment_s: float,
    table: Floats32,
    velocity: Floats32,
    back: bool,
) -> Floats32:
    """(N, 3) each vector turned by the rotation at its time, linear between those of a table.

    Then it moves with the velocity for the time since the moment; backwards, it moves back first.
    """
    result = np.empty((len(vectors), 3), np.float32)
    last = len(table) - 1
    scale = last / (last_s - first_s) if last_s > first_s else 0.0
    for row in range(len(vectors)):
        place = min(max((times_s[row] - first_s) * scale, 0.0), float(last))
        number = min(int(place), last - 1)
        share = np.float32(place - number)
        elapsed_s = np.float32(times_s[row] - moment_s)
        x, y, z = vectors[row, 0], vectors[row, 1], vectors[row, 2]
        if back:
            x -= elapsed_s * velocity[0]
            y -= elapsed_s * velocity[1]
            z -= elapsed_s * velocity[2]
        for axis in range(3):
            before = table[number, axis, 0] * x + table[number, axis, 1] * y
            before += table[number, axis, 2] * z
            after = table[number + 1, axis, 0] * x + table[number + 1, axis, 1] * y
            after += table[number + 1, axis, 2] * z
            result[row, axis] = before + share * (after - before)
            if not back:
                result[row, axis] += elapsed_s * velocity[axis]
    return result
