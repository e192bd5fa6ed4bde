# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Splitting of long objects: a part in space that was free before is an object of its own."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.objects.object_sweep import ObjectSweep, sizes_of
from mnsf_ros.objects.segmentation import Segmentation
from mnsf_ros.objects.target import Target

# Farther off, a wall that is seen along itself looks as if it had been seen through.
_MAX_RANGE_M: Final = 30.0
# A shorter object moves as a whole. A part of a longer one is another object only if it has the
# size of a pedestrian, and if no more of the object is new: else it moved itself.
_SHORT_M: Final = 2.0
_PEDESTRIAN_M: Final = 1.2
# The same of an object that is too long to move as a whole, such as a wall that a car is beside.
_LORRY_M: Final = 8.0
# Points that came lately, in touching cells of this size, are measured as one part: the front of a
# bus has gaps.
_GAP_CELL_M: Final = 0.5


def split(current: ObjectSweep, targets: Sequence[Target]) -> ObjectSweep:
    """Returns the sweep with movers split from what they touch, if they came lately.

    A point came lately if another sweep saw through its place and nothing was near: that of a
    pedestrian in a row of parked cars, or of a car beside a wall.

    Args:
        current: The sweep.
        targets: Sweeps before it.
    """
    objects, sizes = current.thinned_objects, current.sizes
    rows = np.flatnonzero((sizes >= _SHORT_M)[objects])
    points = np.take(current.thinned, rows, axis=0)
    x, y, z = points.T
    is_near = x * x + y * y + z * z < _MAX_RANGE_M**2
    rows, points = rows[is_near], chosen_points(points, is_near)
    has_come = np.zeros(len(rows), dtype=bool)
    for target in targets:
        has_come |= target.are_new(points)
    num_new = np.bincount(objects[rows[has_come]], minlength=len(sizes))
    shares = num_new / np.maximum(np.bincount(objects, minlength=len(sizes)), 1)
    most_m = np.where(current.may_move, _PEDESTRIAN_M, _LORRY_M)
    rows = rows[has_come & (shares * sizes < most_m)[objects[rows]]]
    part_sizes = _part_sizes(np.take(current.thinned, rows, axis=0))
    return current.with_parts(rows[part_sizes < most_m[objects[rows]]])


def _part_sizes(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (P,) metres, the length of the part that each of the points (P, 3) belongs to."""
    if len(points) == 0:
        return np.zeros(0, np.float32)
    parts = Segmentation(points, _GAP_CELL_M)
    numbers = parts.objects_of(points)
    return sizes_of(points, numbers, parts.num_objects)[numbers]
