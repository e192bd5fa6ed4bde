# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Refinement: the motions of movers, which may turn about the vertical axis."""

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.encoded_field import EncodedPoints, Heads, whole
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.target import Targets


def turning(movers: ObjectPoints, motions: NDArray[np.float32], targets: Targets) -> Heads:
    """Returns the heads (K, 3, 3) of K movers: motions of their middles, and turns about these.

    They are fitted to the neighbouring sweeps, as flow fields; of the means of both a stiff object
    leaves the motion on the ground and the turn. The motion stays if that explains no more.

    Args:
        movers: K objects.
        motions: (K, 3) metres, their motions to the next sweep.
        targets: The other sweeps.
    """
    steps = {target: target.steps_of(movers, motions) for target in targets.near}
    points = EncodedPoints(movers, movers.centers, steps)
    straight = whole(motions)
    bent = np.mean([points.fitted(target, straight) for target in targets.near], axis=0)
    stiff = straight.copy()
    stiff[:, 0, :2] = bent[:, 0, :2]
    turns = (bent[:, 1, 1] - bent[:, 2, 0]) / 2
    stiff[:, 1, 1], stiff[:, 2, 0] = turns, -turns
    before, after = (
        np.mean([points.residuals(target, heads) for target in targets.near], axis=0)
        for heads in (straight, stiff)
    )
    return np.where((after < before)[:, None, None], stiff, straight)
