# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Turn rates as a gyroscope of consumer grade on the lidar measures them."""

import math
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats
from mnsf_ros.simulation.routes import SensorTrip

# MPU-6000/MPU-6050, product specification 3.4, section 6.1: noise density, tolerance of the
# sensitivity, and zero-rate output. The latter varies by 20 degrees/s over 60 K; a board that
# warms up by 2 K a minute drifts by:
_NOISE_DEG_S_HZ: Final = 0.005
_SENSITIVITY: Final = 0.03
_BIAS_DEG_S: Final = 20.0
_DRIFT_DEG_S2: Final = 0.01
# Turn rates are rotations between two moments this far apart.
_STEP_S: Final = 1e-4


def turn_rates(
    ego: SensorTrip, times_s: Floats, rate_hz: float, rng: np.random.Generator
) -> Floats:
    """Returns (T, 3) rad/s about the axes of the lidar at (T,) times of a rate.

    They have errors of sensitivity, bias and noise.
    """
    if len(times_s) == 0:
        return np.empty((0, 3))
    before, after = (
        np.array([ego.world_from_sensor(time_s)[:3, :3] for time_s in times_s + shift_s])
        for shift_s in (-_STEP_S / 2, _STEP_S / 2)
    )
    true = Rotation.from_matrix(before.transpose(0, 2, 1) @ after).as_rotvec() / _STEP_S
    bias_deg_s = rng.uniform(-_BIAS_DEG_S, _BIAS_DEG_S, 3)
    drift_deg_s = np.outer(times_s, rng.normal(0.0, _DRIFT_DEG_S2, 3))
    noise_deg_s = rng.normal(0.0, _NOISE_DEG_S_HZ * math.sqrt(rate_hz / 2), true.shape)
    sensitivity = 1.0 + rng.uniform(-_SENSITIVITY, _SENSITIVITY, 3)
    return sensitivity * true + np.radians(bias_deg_s + drift_deg_s + noise_deg_s)
