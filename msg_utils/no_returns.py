# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rays without a hit that a driver or a simulator writes as points."""

from typing import Final

import numpy as np
import numpy.typing as npt

# A shell of rays without a hit is no thicker than this share of its range: noise of 1 cm at 30 m.
_THICKNESS: Final = 0.005
# In sweeps of five lidars the outermost layer of that thickness has up to 0.05 % of the points, and
# twice as many as the next one.
_MIN_POINTS: Final = 100
_MIN_SHARE: Final = 0.01
_MIN_RATIO: Final = 10


def no_returns(xyz: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Returns the mask (N,) of the finite points (N, 3), sensor frame, metres, that are none.

    These are all at the origin, and a shell: at least 1 % of the points at the largest range, and
    hardly any within the next layer. A ring on the ground, which one beam draws, is no shell.
    """
    # Three times faster than a sum over the axis. Hostile numbers become infinite.
    with np.errstate(all="ignore"):
        squared = xyz[:, 0] * xyz[:, 0] + xyz[:, 1] * xyz[:, 1] + xyz[:, 2] * xyz[:, 2]
        none = squared == 0
        farthest = squared.max(initial=0)
        shell = np.flatnonzero(squared > (1 - _THICKNESS) ** 2 * farthest)
        if len(shell) < max(_MIN_POINTS, _MIN_SHARE * len(xyz)):
            return none
        num_next = np.count_nonzero(squared > (1 - 2 * _THICKNESS) ** 2 * farthest) - len(shell)
        height_m = xyz[shell, 2].std(dtype=np.float64)
    is_ring = height_m < _THICKNESS * np.sqrt(farthest)
    if len(shell) > _MIN_RATIO * num_next and not is_ring:
        none[shell] = True
    return none
