"""What is long is not simply standing: parts of it came lately, or all of it moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.target import Target

# Objects of up to so many times the largest size may move as a whole.
_MAX_SIZE: Final = 2.0
# Farther off, a wall that is seen along itself looks as if it had been seen through.
_MAX_RANGE_M: Final = 30.0
# If so much of one came lately, it is one thing that moves; if less, something touches it.
_MIN_SHARE: Final = 0.1


def split(current: ObjectSweep, targets: Sequence[Target], max_size_m: float) -> ObjectSweep:
    """Returns the sweep with long objects split, where a part of them came lately.

    A part came lately if another sweep saw through its place and nothing was near: a pedestrian
    beside a wall, a scooter in a row of parked cars. If it is much of the object, this is a bus or
    a lorry, and may move as a whole though it is long.

    Args:
        current: The sweep.
        targets: Sweeps before it, or whatever others there are.
        max_size_m: Other objects of this length and longer do not move.
    """
    objects, sizes = current.thinned_objects, current.sizes
    rows = np.flatnonzero((sizes >= max_size_m)[objects])
    points = np.take(current.thinned, rows, axis=0)
    is_near = (points**2).sum(axis=1) < _MAX_RANGE_M**2
    rows, points = rows[is_near], np.compress(is_near, points, axis=0)
    has_come = np.zeros(len(rows), dtype=bool)
    for target in targets:
        has_come |= target.are_new(points)
    num_new = np.bincount(objects[rows[has_come]], minlength=len(sizes))
    counts = np.bincount(objects, minlength=len(sizes))
    is_mostly_old: NDArray[np.bool_] = num_new < _MIN_SHARE * counts
    may_move = (sizes < max_size_m) | ~is_mostly_old & (sizes < _MAX_SIZE * max_size_m)
    return current.with_parts(rows[has_come & is_mostly_old[objects[rows]]], may_move)
