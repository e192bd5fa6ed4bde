# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The angle between neighbouring columns of a lidar."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats32

# Elevations within this are those of one beam, or of two.
_BEAM_RAD: Final = np.radians(0.3)
# So many of the elevations with most points are looked at, if they have so many points.
_NUM_BEAMS: Final = 20
_MIN_POINTS: Final = 50


def azimuth_step(xyz: Floats32) -> float:
    """Returns the usual angle between neighbouring points of a beam, radians; 0 if unknown.

    Args:
        xyz: (N, 3) metres, frame of the lens, z along the axis of the beams.
    """
    x, y, z = xyz[xyz.any(axis=1)].T.astype(np.float64)
    beams = np.floor(np.arctan2(z, np.hypot(x, y)) / _BEAM_RAD).astype(np.int64)
    azimuths = np.arctan2(y, x)
    numbers, counts = np.unique(beams, return_counts=True)
    fullest = np.argsort(-counts, kind="stable")[:_NUM_BEAMS]
    steps = [
        np.diff(np.sort(azimuths[beams == numbers[each]]))
        for each in fullest
        if counts[each] >= _MIN_POINTS
    ]
    return float(np.median(np.concatenate(steps))) if steps else 0.0
