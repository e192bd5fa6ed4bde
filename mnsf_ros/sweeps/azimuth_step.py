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
    ranges = np.linalg.norm(xyz, axis=1)
    is_seen = ranges > 0
    xyz, ranges = xyz[is_seen], ranges[is_seen]
    beams = np.floor(np.arcsin(np.clip(xyz[:, 2] / ranges, -1, 1)) / _BEAM_RAD).astype(np.int64)
    azimuths = np.arctan2(xyz[:, 1], xyz[:, 0])
    numbers, counts = np.unique(beams, return_counts=True)
    fullest = np.argsort(-counts, kind="stable")[:_NUM_BEAMS]
    steps = [
        np.diff(np.sort(azimuths[beams == numbers[each]]))
        for each in fullest
        if counts[each] >= _MIN_POINTS
    ]
    return float(np.median(np.concatenate(steps))) if steps else 0.0
