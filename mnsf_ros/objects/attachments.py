# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points that belong to a mover but not to its object: fragments, and cut-off bottoms."""

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_points import NOISE_M, ObjectPoints, spacing_of
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.point_grid import PointGrid


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
    # Beside a mover, what is above the ground by more than the noise is not ground.
    low = np.flatnonzero(~current.kept & (current.heights > NOISE_M))
    low = low[current.heights[low] > spacing_of(np.take(current.xyz, low, axis=0))]
    candidates = np.union1d(low, np.flatnonzero(is_loose[owners]))
    theirs = owners[candidates]
    nearest = PointGrid(points).nearest(np.take(current.xyz, candidates, axis=0))
    is_close = nearest >= 0
    # A fragment moves as a whole, or not at all.
    votes = np.where(is_close, 1, -1)
    goes = np.bincount(theirs, votes, current.num_objects) > 0
    goes[0] = True
    is_close &= goes[theirs]
    return candidates[is_close], point_rows[nearest[is_close]]
