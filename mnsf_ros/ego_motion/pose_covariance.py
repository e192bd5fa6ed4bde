"""How uncertain a pose is that is chained from steps: the covariances of nav_msgs/Odometry.

All are (6, 6) float64: x, y, z in metres, then rotations about x, y and z in radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class StepNoise:
    """Standard deviations of the motion from one sweep to the next, of each axis.

    Attributes:
        shift_m: Metres.
        shift_share: More of that, for each metre of the way.
        turn_rad: Radians.
        turn_share: More of that, for each radian of the turn.
    """

    shift_m: float
    shift_share: float
    turn_rad: float
    turn_share: float


def step_covariance(motion: NDArray[np.float64], noise: StepNoise) -> NDArray[np.float64]:
    """Returns the covariance of a step, in the axes of the sensor before it.

    Args:
        motion: (4, 4) last_from_sensor.
        noise: What is known of its source.
    """
    way_m = float(np.linalg.norm(motion[:3, 3]))
    angle_rad = float(Rotation.from_matrix(motion[:3, :3]).magnitude())
    shift_m = noise.shift_m + noise.shift_share * way_m
    turn_rad = noise.turn_rad + noise.turn_share * angle_rad
    return np.diag([shift_m**2] * 3 + [turn_rad**2] * 3)


def chained_covariance(
    covariance: NDArray[np.float64],
    world_from_last: NDArray[np.float64],
    motion: NDArray[np.float64],
    step: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Returns the covariance of the pose after a step, in the axes of the world.

    An error of the heading becomes one of the position with the way: it grows without end.

    Args:
        covariance: Of the pose before the step, in the axes of the world.
        world_from_last: (4, 4), that pose.
        motion: (4, 4) last_from_sensor.
        step: The covariance of the step.
    """
    turn = world_from_last[:3, :3]
    x, y, z = turn @ motion[:3, 3]
    carried = np.eye(6)
    carried[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    axes = np.kron(np.eye(2), turn)
    result: NDArray[np.float64] = carried @ covariance @ carried.T + axes @ step @ axes.T
    return (result + result.T) / 2


def unknown_covariance() -> NDArray[np.float64]:
    """Returns a covariance that says that nothing is known."""
    return 1e6 * np.eye(6)
