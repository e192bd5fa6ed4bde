# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The first guess: where the fit of an object's motion starts."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motions import best_of
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.suspects import are_worth_a_fit
from mnsf_ros.objects.table import ObjectTable
from mnsf_ros.objects.voting import voted_motions

# In older sweeps, motions that differ from the best in the neighbouring ones by less are tried: the
# work grows with the square.
_MAX_CHANGE_M_S: Final = 12.0


def first_guesses(
    table: ObjectTable, scene: Scene
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns (K, 3) metres to the next sweep to start from, and (K,) if any is worth a fit.

    The shift with most votes of the neighbouring sweeps and what a track expects are compared, then
    that of the older sweeps around the best of them: for slow objects, and for long ones whose
    sides look alike.

    Args:
        table: K suspects.
        scene: The sweeps.
    """
    if len(table) == 0:
        return table.start, np.zeros(0, dtype=bool)
    some, expected, best = table.points.thinner(), table.expected, table.standing
    targets, interval_s = scene.targets, scene.usual_interval_s
    reach_m, changed_m = scene.settings.max_speed_m_s * interval_s, _MAX_CHANGE_M_S * interval_s
    voted = voted_motions(some, targets.near, reach_m, best.motions)
    best = best_of(some, targets, best, expected.beside(voted), expected.surprise)
    if targets.past:
        voted = voted_motions(some, targets.past, changed_m, best.motions)
        best = best_of(some, targets, best, [voted], expected.surprise)
    return best.motions, are_worth_a_fit(table, best, targets)
