# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The forward and the backward field: one translation for each object, fitted to one target."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.target import Target

# Nearest points underestimate motion along surfaces: a longer step converges sooner.
_STEP: Final = 1.8


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
    slopes = target.current.ground.slopes(objects.centers)
    flows = num_steps * start
    for _ in range(num_iterations):
        flows[:, 2] = (slopes * flows[:, :2]).sum(axis=1)
        flows += (_STEP * target.pulls(objects, flows)).astype(np.float32)
    flows[:, 2] = (slopes * flows[:, :2]).sum(axis=1)
    return np.asarray(flows * (np.float32(target.steps) / num_steps), np.float32)
