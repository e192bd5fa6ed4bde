# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The first guess: where the fit of an object's motion starts."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.online.motions import best_of
from mnsf_ros.online.scene import Scene
from mnsf_ros.online.suspects import are_worth_a_fit
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.voting import voted_motions

# In older sweeps, only motions within this of the best one in the neighbouring sweeps are tried:
# the work grows with the square.
_MAX_CHANGE_M_S: Final = 12.0


def first_guesses(
    table: ObjectTable, scene: Scene
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns (K, 3) metres to the next sweep to start from, and (K,) if any is worth a fit.

    First the candidates are no motion, the shift with most votes in the neighbouring sweeps, and
    the track's prediction. Then the older sweeps vote on shifts around the best of these. They help
    with slow objects, and with long ones whose sides look the same everywhere.

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
    best = best_of(some, targets, best, expected.candidates(voted), expected.prior_cost)
    if targets.past:
        voted = voted_motions(some, targets.past, changed_m, best.motions)
        best = best_of(some, targets, best, [voted], expected.prior_cost)
    return best.motions, are_worth_a_fit(table, best, targets)
