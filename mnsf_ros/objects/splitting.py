# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Splitting of long objects: a part in space that was free before is an object of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.objects.object_sweep import ObjectSweep, sizes_of
from mnsf_ros.objects.segmentation import Segmentation
from mnsf_ros.objects.target import Target

# Objects of up to so many times the largest size may move as a whole.
_MAX_SIZE: Final = 2.0
# Farther off, a wall that is seen along itself looks as if it had been seen through.
_MAX_RANGE_M: Final = 30.0
# If so much of one came lately, it is one thing that moves; if less, something touches it.
_MIN_SHARE: Final = 0.1
# Shorter objects, from this length on, move as a whole, and a part of them is another object only
# if it has the size of a pedestrian and is less of it than this: a front of a bus is larger.
_SHORT_M: Final = 2.0
_MIN_SHARE_OF_SHORT: Final = 0.3
_PEDESTRIAN_M: Final = 1.2
# Points that came lately, in touching cells of this size, are measured as one part: the front of a
# bus has gaps.
_GAP_CELL_M: Final = 0.5


def split(current: ObjectSweep, targets: Sequence[Target], max_size_m: float) -> ObjectSweep:
    """Returns the sweep with objects split, where a part of them came lately.

    A part came lately if another sweep saw through its place and nothing was near: a pedestrian
    beside a wall, a scooter in a row of parked cars. If it is much of the object, this is a bus or
    a lorry, and may move as a whole though it is long. What is shorter than `max_size_m` may move
    anyway: of it only pedestrians are split.

    Args:
        current: The sweep.
        targets: Sweeps before it, or whatever others there are.
        max_size_m: Other objects of this length and longer do not move.
    """
    objects, sizes = current.thinned_objects, current.sizes
    is_long = sizes >= max_size_m
    rows = np.flatnonzero((is_long | (sizes >= _SHORT_M))[objects])
    points = np.take(current.thinned, rows, axis=0)
    x, y, z = points.T
    is_near = x * x + y * y + z * z < _MAX_RANGE_M**2
    rows, points = rows[is_near], chosen_points(points, is_near)
    has_come = np.zeros(len(rows), dtype=bool)
    for target in targets:
        has_come |= target.are_new(points)
    num_new = np.bincount(objects[rows[has_come]], minlength=len(sizes))
    shares = num_new / np.maximum(np.bincount(objects, minlength=len(sizes)), 1)
    is_mostly_old: NDArray[np.bool_] = shares < np.where(is_long, _MIN_SHARE, _MIN_SHARE_OF_SHORT)
    may_move = ~is_long | ~is_mostly_old & (sizes < _MAX_SIZE * max_size_m)
    rows = rows[has_come & is_mostly_old[objects[rows]]]
    is_part = is_long[objects[rows]]
    is_part |= _part_sizes(np.take(current.thinned, rows, axis=0)) < _PEDESTRIAN_M
    return current.with_parts(rows[is_part], may_move)


def _part_sizes(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (P,) metres, the length of the part that each of the points (P, 3) belongs to."""
    if len(points) == 0:
        return np.zeros(0, np.float32)
    parts = Segmentation(points, _GAP_CELL_M)
    numbers = parts.objects_of(points)
    return sizes_of(points, numbers, parts.num_objects)[numbers]
