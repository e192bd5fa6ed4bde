# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points that belong to a mover but not to its object: fragments, and cut-off bottoms."""

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.objects.object_points import NOISE_M, ObjectPoints, spacing_of
from mnsf_ros.objects.object_sweep import ObjectSweep


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
    candidates = np.flatnonzero(is_loose[owners] | (current.heights > NOISE_M) & ~current.kept)
    theirs, places = owners[candidates], np.take(current.xyz, candidates, axis=0)
    near = np.flatnonzero(_are_beside(points, places))
    # Beside a mover, what is above the ground by more than the noise is not ground.
    above_m = current.heights[candidates[near]] - spacing_of(np.take(places, near, axis=0))
    near = near[is_loose[theirs[near]] | (above_m > 0)]
    nearest = np.full(len(candidates), -1)
    nearest[near] = PointGrid(points).nearest(np.take(places, near, axis=0))
    is_close = nearest >= 0
    # A fragment moves as a whole, or not at all.
    votes = np.where(is_close, 1, -1)
    goes = np.bincount(theirs, votes, current.num_objects) > 0
    goes[0] = True
    is_close &= goes[theirs]
    return candidates[is_close], point_rows[nearest[is_close]]


def _are_beside(points: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Returns (Q,) which places (Q, 3) are in the cells of points (P, 3) or beside these."""
    low = points[:, :2].min(axis=0) - np.float32(2 * REACH_M)
    own, others = (
        ((xyz[:, :2] - low) / np.float32(REACH_M)).astype(np.int64) for xyz in (points, places)
    )
    is_beside = np.zeros(own.max(axis=0) + 3, np.bool_)
    for shift in np.ndindex(3, 3):
        is_beside[tuple((own + shift - 1).T)] = True
    return is_beside[tuple(np.clip(others, 0, np.array(is_beside.shape) - 1).T)]
