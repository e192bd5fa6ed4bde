# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What is seen of walls and kerbs travels along with the sensor."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.target import Target

# Walls seen from aside, with their noise, are less wide; most vehicles are wider.
_MAX_WIDTH_M: Final = 0.3
# What slides along itself moves across its length by less than this share of its motion.
_MAX_ACROSS: Final = 0.3
# What is seen of walls at an angle to the way travels at another speed, up to this share of it.
_MAX_OFF: Final = 0.4
# Below, a motion of the sensor is hardly told from none.
_MIN_STEP_M: Final = 0.1


def are_travelling_views(objects: ObjectPoints, motions: Floats32, next_: Target) -> Bools:
    """Returns (K,) which motions a view explains that travels along with the sensor.

    Smooth and wet walls return only near their normal, all walls in fog only near the sensor: what
    is seen of a flat surface slides along it as the sensor does.

    Args:
        objects: K objects.
        motions: (K, 3) metres, to the next sweep.
        next_: That sweep.
    """
    with_sensor = (transformed(objects.centers, next_.to_current) - objects.centers)[:, :2]
    steps_m = np.linalg.norm(with_sensor, axis=1)
    off_m = np.linalg.norm(motions[:, :2] - with_sensor, axis=1)
    angles, (_, widths_m, _) = objects.angles, objects.extents
    across_m = np.abs(motions[:, 1] * np.cos(angles) - motions[:, 0] * np.sin(angles))
    slide = across_m < _MAX_ACROSS * np.linalg.norm(motions[:, :2], axis=1)
    are_flat = slide & (widths_m < _MAX_WIDTH_M)
    return np.asarray(are_flat & (steps_m > _MIN_STEP_M) & (off_m < _MAX_OFF * steps_m))
