# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Covariances of the sensor's pose and of its motion from sweep to sweep.

The layout is as in nav_msgs/Odometry, (6, 6) float64: x, y, z in metres, then rotations about x, y
and z in radians.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats

UNKNOWN_COVARIANCE: Final = 1e6 * np.eye(6)


@dataclass(frozen=True)
class StepNoise:
    """Standard deviations of the motion from one sweep to the next, of each axis."""

    shift_m: float
    shift_share: float  # additional metres per metre travelled
    turn_rad: float
    turn_share: float  # additional radians per radian turned


def six_axes(turn: Floats) -> Floats:
    """Returns the (6, 6) rotation of two vectors by a rotation (3, 3)."""
    return np.asarray(np.kron(np.eye(2), turn), np.float64)


def step_covariance(motion: Floats, noise: StepNoise) -> Floats:
    """Returns the covariance of a step last_from_sensor (4, 4), in the axes of `last`."""
    way_m = float(np.linalg.norm(motion[:3, 3]))
    angle_rad = float(Rotation.from_matrix(motion[:3, :3]).magnitude())
    shift_m = noise.shift_m + noise.shift_share * way_m
    turn_rad = noise.turn_rad + noise.turn_share * angle_rad
    return np.diag([shift_m**2] * 3 + [turn_rad**2] * 3)


def chained_covariance(
    covariance: Floats, world_from_last: Floats, motion: Floats, step: Floats
) -> Floats:
    """Returns the covariance of a pose, world axes, after a random motion with covariance `step`.

    A heading error causes a position error that grows with distance travelled, without limit.
    """
    turn = world_from_last[:3, :3]
    x, y, z = turn @ motion[:3, 3]
    carried = np.eye(6)
    carried[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    axes = six_axes(turn)
    result: Floats = carried @ covariance @ carried.T + axes @ step @ axes.T
    return (result + result.T) / 2
