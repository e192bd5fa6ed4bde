# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The forward and the backward field: one translation for each object, fitted to one target."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.target import Target

# Nearest points underestimate motion along surfaces: a longer step converges sooner.
_STEP: Final = 1.8
# Nothing climbs more steeply, by the road and by how the sensor is mounted. Where a part of an
# object is hidden in the target, the nearest points lead up or down.
_STEEPEST: Final = np.float32(0.15)


def fit_motion_field(
    objects: ObjectPoints, target: Target, start: NDArray[np.float32], num_iterations: int
) -> NDArray[np.float32]:
    """Moves each object until it lies on the target.

    Returns (K, 3) metres, from the current sweep to the target, after the interval between their
    stamps.

    Args:
        objects: K objects of the current sweep.
        target: The sweep at t+1 for the forward field, at t-1 for the backward field.
        start: (K, 3) metres, motion to the next sweep to start from.
        num_iterations: Steps.
    """
    num_steps = target.steps_of(objects, start)
    flows = num_steps * start
    for _ in range(num_iterations):
        pulls = target.pulls(objects, flows)
        flows = flows + (_STEP * pulls).astype(np.float32)
        climbs = _STEEPEST * np.hypot(flows[:, 0], flows[:, 1])
        flows[:, 2] = np.clip(flows[:, 2], -climbs, climbs)
    return np.asarray(flows * (np.float32(target.steps) / num_steps), np.float32)
