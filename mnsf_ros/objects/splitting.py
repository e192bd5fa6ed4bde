# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Splitting of long objects: a part in space that was free before is an object of its own."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.segmentation import Segmentation
from mnsf_ros.objects.object_sweep import TOUCH_M, ObjectSweep, sizes_of
from mnsf_ros.objects.target import Target

# A shorter object moves as a whole. A part of a longer one is another object only if it has the
# size of a pedestrian, and if no more of the object is new: else it moved itself.
_PEDESTRIAN_M: Final = 1.2


def split(current: ObjectSweep, targets: Sequence[Target]) -> ObjectSweep:
    """Returns the sweep with movers split from what they touch, if they came lately.

    A point came lately if another sweep saw through its place and nothing was near: that of a
    pedestrian in a row of parked cars.

    Args:
        current: The sweep.
        targets: Sweeps before it.
    """
    objects, sizes = current.thinned_objects, current.sizes
    rows = np.flatnonzero((sizes >= _PEDESTRIAN_M)[objects])
    points = np.take(current.thinned, rows, axis=0)
    has_come = np.zeros(len(rows), dtype=bool)
    for target in targets:
        has_come |= target.are_new(points)
    num_new = np.bincount(objects[rows[has_come]], minlength=len(sizes))
    shares = num_new / np.maximum(np.bincount(objects, minlength=len(sizes)), 1)
    rows = rows[has_come & (shares * sizes < _PEDESTRIAN_M)[objects[rows]]]
    part_sizes = _part_sizes(np.take(current.thinned, rows, axis=0))
    return current.with_parts(rows[part_sizes < _PEDESTRIAN_M])


def _part_sizes(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (P,) metres, the length of the part that each of the points (P, 3) belongs to."""
    if len(points) == 0:
        return np.zeros(0, np.float32)
    parts = Segmentation(points, TOUCH_M)
    numbers = parts.objects_of(points)
    return sizes_of(points, numbers, parts.num_objects)[numbers]
