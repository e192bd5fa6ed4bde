# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Surfaces of boxes that all move alike."""

import numpy as np

# Metres per sweep.
MOTION = np.array([0.3, 0.1, 0.0], np.float32)

_BOXES = (
    # center x, y, size x, y, z
    (8, 3, 4, 2, 2),
    (12, -4, 4, 2, 2),
    (5, -6, 1, 1, 2),
    (-9, 5, 5, 2, 3),
    (-7, -7, 2, 4, 2),
    (15, 6, 2, 2, 4),
)


def surfaces(sweep_index=0, num_points=1200):
    """(num_points, 3) float32: the same points of the boxes' surfaces in each sweep, moved."""
    random = np.random.default_rng(0)
    parts = []
    for x, y, *size in _BOXES:
        num = num_points // len(_BOXES)
        unit = random.uniform(-0.5, 0.5, (num, 3))
        unit[np.arange(num), random.integers(0, 3, num)] = random.choice((-0.5, 0.5), num)
        parts.append(unit * size + (x, y, size[2] / 2 - 1.5))  # as seen from the lidar
    return np.concatenate(parts).astype(np.float32) + np.float32(sweep_index) * MOTION
