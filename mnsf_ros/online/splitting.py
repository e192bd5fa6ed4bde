# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Splitting: new points become parts of the objects that they touch."""

from collections.abc import Sequence

import numpy as np

from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.target import Target


def split(current: ObjectSweep, targets: Sequence[Target]) -> ObjectSweep:
    """Returns the sweep with new points as parts of the objects that they touch.

    A point is new if another sweep saw through its place and had no point near it. It may belong
    to a pedestrian in a row of parked cars, or to the front of a bus; `moves` decides.

    Args:
        current: The sweep.
        targets: Sweeps before it.
    """
    has_come = np.zeros(len(current.thinned), dtype=bool)
    for target in targets:
        has_come |= target.are_new(current.thinned)
    return current.with_parts(np.flatnonzero(has_come & (current.thinned_objects > 0)))
