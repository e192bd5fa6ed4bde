# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which movers are one thing: close to each other, with the same motion."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mnsf_ros.objects.object_points import ObjectPoints

# Movers this close to each other are one if their motions differ by less than this plus this share.
_REACH_M: Final = 0.5
_POINTS_PER_MOVER: Final = 16
_SAME_MOTION_M: Final = 0.08
_SAME_MOTION_SHARE: Final = 0.15


def mover_groups(movers: ObjectPoints, motions: NDArray[np.float32]) -> NDArray[np.int64]:
    """Returns (K,) the number from 0 of the thing that each of K movers is a part of.

    Args:
        movers: K objects that move.
        motions: (K, 3) metres, their motions to the next sweep.
    """
    if len(movers) == 0:
        return np.zeros(0, np.int64)
    some = movers.thinner(_POINTS_PER_MOVER)
    pairs = some.owners[cKDTree(some.positions).query_pairs(_REACH_M, output_type="ndarray")]
    first, second = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).T
    apart = np.sqrt(((motions[first] - motions[second]) ** 2).sum(axis=1))
    lengths = np.sqrt((motions**2).sum(axis=1))
    longer = np.maximum(lengths[first], lengths[second])
    are_same = apart < _SAME_MOTION_M + _SAME_MOTION_SHARE * longer
    ones = np.ones(np.count_nonzero(are_same), np.int8)
    graph = coo_matrix((ones, (first[are_same], second[are_same])), shape=(len(movers),) * 2)
    groups: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return groups
