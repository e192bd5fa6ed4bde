# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Splitting of objects: what came lately is judged as a part, beside the whole that it touches."""

from collections.abc import Sequence

import numpy as np

from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.target import Target


def split(current: ObjectSweep, targets: Sequence[Target]) -> ObjectSweep:
    """Returns the sweep with what came lately as parts of what it touches.

    A point came lately if another sweep saw through its place and nothing was near: that of a
    pedestrian in a row of parked cars, or of the front of a bus. Which of both tells `moves`.

    Args:
        current: The sweep.
        targets: Sweeps before it.
    """
    has_come = np.zeros(len(current.thinned), dtype=bool)
    for target in targets:
        has_come |= target.are_new(current.thinned)
    return current.with_parts(np.flatnonzero(has_come & (current.thinned_objects > 0)))
