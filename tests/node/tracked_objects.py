# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Objects as the method makes them, of any id, place and motion."""

from __future__ import annotations

import numpy as np

from mnsf_ros.core.flow_estimate import TrackedObject


def tracked(track_id=1, **changes):
    """A car at (10, -2) that drives 5 m/s to the left of the sensor, its heading."""
    values = {
        "center": np.array([10.0, -2.0, 0.5]),
        "size": np.array([4.0, 1.8, 1.5]),
        "yaw": np.pi / 2,
        "velocity": np.array([0.0, 5.0, 0.0]),
        "covariance": np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]),
        "age_s": 2.5,
        "num_points": 120,
    }
    return TrackedObject(track_id=track_id, **values | changes)
