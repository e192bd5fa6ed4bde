# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The sensor's motion during a sweep, and the correction of points to one moment."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

# Gains for a new motion, along x, y and z, and about them. A vehicle pitches, rolls and heaves on
# its springs within a few sweeps: in these axes the last interval predicts little of the next one.
_GAINS: Final = np.array([0.5, 0.5, 0.1, 0.1, 0.1, 0.5])
# Motions are alike if, within `_WITHIN_S`, they move points at `_FAR_M` by less than
# `_MAX_DIFFERENCE_M` differently.
_WITHIN_S: Final = 0.1
_FAR_M: Final = 30.0
_MAX_DIFFERENCE_M: Final = 0.2


@dataclass(frozen=True, eq=False)
class SweepMotion:
    """Motion of constant velocity and turn rate.

    Attributes:
        velocity: (6,) float64 along x, y and z of the sensor in m/s, then about them in rad/s.
        moment_s: Seconds from the stamp of the sweep to the moment that points are corrected to.
    """

    velocity: NDArray[np.float64]
    moment_s: float

    @classmethod
    def of_step(
        cls, step: NDArray[np.float64], interval_s: float, moment_s: float
    ) -> "SweepMotion":
        """Returns the motion of a step before_from_after (4, 4) within an interval above 0."""
        turn = Rotation.from_matrix(step[:3, :3]).as_rotvec()
        # The step is in the axes of its beginning; in a bend the sensor moves along those of the
        # middle.
        shift = Rotation.from_rotvec(-turn / 2).apply(step[:3, 3])
        return cls(np.concatenate([shift, turn]) / interval_s, moment_s)

    @property
    def moment_from_stamp(self) -> NDArray[np.float64]:
        """(4, 4) pose of the sensor at the stamp, in its frame at the moment."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(-self.moment_s * self.velocity[3:]).as_matrix()
        pose[:3, 3] = -self.moment_s * self.velocity[:3]
        return pose

    def is_like(self, other: "SweepMotion") -> bool:
        """Whether two motions move the points of a sweep to about the same places."""
        difference = _GAINS / _GAINS.max() * (self.velocity - other.velocity) * _WITHIN_S
        shift_m, turn_rad = np.linalg.norm(difference[:3]), np.linalg.norm(difference[3:])
        return bool(shift_m + _FAR_M * turn_rad < _MAX_DIFFERENCE_M)

    def towards(self, newer: "SweepMotion") -> "SweepMotion":
        """Returns a weighted mean with a newer motion, so that noise does not distort sweeps."""
        change = _GAINS * (newer.velocity - self.velocity)
        return SweepMotion(self.velocity + change, newer.moment_s)

    def moved(self, xyz: NDArray[np.float32], times_s: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns static points as seen at the moment.

        Args:
            xyz: (N, 3) metres, each in the frame of the sensor when it measured the point.
            times_s: (N,) seconds from the stamp to that.

        Returns:
            (N, 3) metres, frame of the sensor at the moment.
        """
        elapsed_s = times_s - np.float32(self.moment_s)
        moved = self._turned(xyz, elapsed_s)
        for axis in range(3):
            moved[:, axis] += elapsed_s * np.float32(self.velocity[axis])
        return moved

    def turned_back(
        self, vectors: NDArray[np.float32], times_s: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Returns vectors (N, 3), given in axes of the moment, in sensor axes at `times_s` (N,)."""
        return self._turned(vectors, np.float32(self.moment_s) - times_s)

    def _turned(
        self, vectors: NDArray[np.float32], elapsed_s: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """(N, 3) each vector turned as the sensor turns in its time (Rodrigues' formula)."""
        rate = float(np.linalg.norm(self.velocity[3:]))
        if rate == 0.0:
            return vectors.copy()
        axes = (self.velocity[3:] / rate).astype(np.float32)
        angles = elapsed_s * np.float32(rate)
        sines, cosines = np.sin(angles), np.cos(angles)
        # By column: numpy takes several times as long over the short axis of an array.
        columns = [np.ascontiguousarray(vectors[:, axis]) for axis in range(3)]
        along = columns[0] * axes[0] + columns[1] * axes[1] + columns[2] * axes[2]
        along *= 1 - cosines
        result = np.empty_like(vectors)
        for axis in range(3):
            second, third = (axis + 1) % 3, (axis + 2) % 3
            column = columns[third] * axes[second] - columns[second] * axes[third]
            column *= sines
            column += columns[axis] * cosines
            column += along * axes[axis]
            result[:, axis] = column
        return result
