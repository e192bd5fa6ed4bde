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
    objects: ObjectPoints,
    targets: Sequence[Target],
    max_motion_m: float,
    base: NDArray[np.float32],
    number: int,
) -> list[NDArray[np.float32]]:
    """Tries all horizontal shifts of each object on a coarse grid.

    A shift gets a vote for each point that meets an occupied cell of the next sweep, and one if
    the opposite shift meets one of the previous sweep.

    Args:
        objects: K objects of the current sweep.
        targets: The other sweeps.
        max_motion_m: Longest shift tried, for one step.
        base: (K, 3) metres, motion of one step that shifts are added to.
        number: How many shifts of each object are wanted.

    Returns:
        (K, 3) metres each, motions of one step, the best ones first.
    """
    objects = objects.thinner(_POINTS_PER_OBJECT)
    farthest = max(1.0, *(abs(target.steps) for target in targets))
    base_m = float(np.abs(base).max(initial=0.0))
    grid = VotingGrid(objects.positions, margin_m=(max_motion_m + base_m) * farthest)
    shifts = _shifts(int(max_motion_m / grid.cell_m))
    cost = np.float32(_COST_PER_M * grid.cell_m) * np.hypot(*shifts.T).astype(np.float32)
    shifted = [
        (target, grid.occupied(target), grid.steps(np.rint(shifts * target.steps).astype(np.int64)))
        for target in targets
    ]
    best = np.tile(base, (number, 1, 1))
    group_size = max(1, _MAX_TRIES // (_POINTS_PER_OBJECT * len(shifts)))
    groups = np.arange(len(objects)) // group_size
    for group in range(-(-len(objects) // group_size)):
        is_own = groups == group
        some, own_base = objects.only(is_own), base[is_own]
        hits = np.zeros((len(some.owners), len(shifts)), np.float32)
        for target, occupied, steps in shifted:
            moved = some.positions + np.float32(target.steps) * own_base[some.owners]
            hits += occupied[grid.cells_of(moved)[:, None] + steps[None]]
        votes = some.sums(hits) / some.counts[:, None].astype(np.float32) - cost
        for rank in range(number):
            chosen = shifts[votes.argmax(axis=1)]
            best[rank, is_own, :2] += (chosen * grid.cell_m).astype(np.float32)
            # The next one is no neighbour of this.
            votes[(np.abs(shifts[None] - chosen[:, None]) <= 1).all(axis=2)] = -np.inf
    return list(best)


def _shifts(radius: int) -> NDArray[np.int64]:
    """(S, 2) all whole shifts in a disc, in cells, nearest first."""
    side = np.arange(-radius, radius + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side, indexing="ij"))
    length = x * x + y * y
    order = np.argsort(length, kind="stable")
    order = order[length[order] <= radius * radius]
    return np.stack([x[order], y[order]], axis=1)
