# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Visibility of objects in other sweeps: free space and occlusion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import Targets
from mnsf_ros.objects.object_points import ObjectPoints


@dataclass(frozen=True, eq=False)
class Visibility:
    """Free and visible shares of K objects in other sweeps.

    A place that was seen through is evidence of motion. A place that was hidden is none: there a
    static object leaves a residual, too.

    Attributes:
        free: (K,) share of each object's points that are in free space of a sweep if the object is
            static, summed over the sweeps, less the same if it moves.
        visible_past: (K, S) share of its points that are not behind something in each of S older
            sweeps if it is static.
    """

    free: NDArray[np.float64]
    visible_past: NDArray[np.float64]

    @classmethod
    def of(
        cls, objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
    ) -> Visibility:
        """Returns the visibility in the targets of K objects with motions (K, 3), metres."""
        free = np.zeros(len(objects))
        visible_past = np.zeros((len(objects), len(targets.past)))
        for number, target in enumerate((*targets.past, *targets.near)):
            is_free, is_hidden = target.seen(objects)
            free += is_free - target.seen(objects, motions)[0]
            if number < len(targets.past):
                visible_past[:, number] = 1 - is_hidden
        return cls(free, visible_past)
