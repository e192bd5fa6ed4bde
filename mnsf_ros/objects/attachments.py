# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points that belong to a mover but not to its object: fragments, and cut-off bottoms."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.point_grid import PointGrid

# Beside a mover, a point this far above the ground is not ground.
_MIN_HEIGHT_M: Final = 0.1
# A fragment moves with a mover if more than this share of it is in reach.
_MIN_SHARE: Final = 0.5


def attached(
    current: ObjectSweep,
    owners: NDArray[np.int64],
    movers: ObjectPoints,
    is_loose: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns which points beside movers move with them.

    Args:
        current: The sweep.
        owners: (N,) the object of each point, see `ObjectSweep.objects`.
        movers: K objects that move.
        is_loose: (all objects of the sweep,) those that may be fragments: not known to be static.

    Returns:
        (M,) the points, none of the movers' own among them, and (M,) the row of the mover of each.
    """
    if len(movers) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    points, point_rows = movers.all_points(current)
    is_low = ~current.kept & (current.heights > _MIN_HEIGHT_M)
    candidates = np.flatnonzero(is_low | is_loose[owners])
    theirs = owners[candidates]
    nearest = PointGrid(points).nearest(np.take(current.xyz, candidates, axis=0))
    is_close = nearest >= 0
    # A fragment moves as a whole, or not at all.
    close, number = (np.bincount(each, minlength=1) for each in (theirs[is_close], theirs))
    goes = np.zeros(len(number), np.bool_)
    goes[: len(close)] = close > _MIN_SHARE * number[: len(close)]
    goes[0] = True
    is_close &= goes[theirs]
    return candidates[is_close], point_rows[nearest[is_close]]
