"""A first guess of each object's motion: the shift on which both neighbouring sweeps agree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.target import Target
from mnsf_ros.objects.voting_grid import VotingGrid

_POINTS_PER_OBJECT: Final = 24
# Of shifts that fit an object equally well, the shorter is more likely: votes per metre.
_COST_PER_M: Final = 0.02
# Points times shifts tried at once, 13 bytes each: after a long interval there are many shifts.
_MAX_TRIES: Final = 4_000_000


def voted_motions(
    objects: ObjectPoints, targets: Sequence[Target], max_motion_m: float
) -> NDArray[np.float32]:
    """Tries all horizontal shifts of each object on a coarse grid.

    A shift gets a vote for each point that meets an occupied cell of the next sweep, and one if
    the opposite shift meets one of the previous sweep.

    Args:
        objects: K objects of the current sweep.
        targets: The sweep at t+1, and that at t-1 where there is one.
        max_motion_m: Longest shift tried.

    Returns:
        (K, 3) metres, to the next sweep; the third is 0.
    """
    objects = objects.thinner(_POINTS_PER_OBJECT)
    farthest = max(1.0, *(abs(target.steps) for target in targets))
    grid = VotingGrid(objects.positions, margin_m=max_motion_m * farthest)
    shifts = _shifts(int(max_motion_m / grid.cell_m))
    cost = np.float32(_COST_PER_M * grid.cell_m) * np.hypot(*shifts.T).astype(np.float32)
    shifted = [
        (grid.occupied(target), grid.steps(np.rint(shifts * target.steps).astype(np.int64)))
        for target in targets
    ]
    best = np.zeros((len(objects), 3), np.float32)
    group_size = max(1, _MAX_TRIES // (_POINTS_PER_OBJECT * len(shifts)))
    groups = np.arange(len(objects)) // group_size
    for group in range(-(-len(objects) // group_size)):
        some = objects.only(groups == group)
        cells = grid.cells_of(some.positions)
        hits = np.zeros((len(cells), len(shifts)), np.float32)
        for occupied, steps in shifted:
            hits += occupied[cells[:, None] + steps[None]]
        votes = some.sums(hits) / some.counts[:, None].astype(np.float32) - cost
        best[groups == group, :2] = shifts[votes.argmax(axis=1)] * grid.cell_m
    return best


def _shifts(radius: int) -> NDArray[np.int64]:
    """(S, 2) all whole shifts in a disc, in cells, nearest first."""
    side = np.arange(-radius, radius + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side, indexing="ij"))
    length = x * x + y * y
    order = np.argsort(length, kind="stable")
    order = order[length[order] <= radius * radius]
    return np.stack([x[order], y[order]], axis=1)
