# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Where the fits start: the best of several guesses of each motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_field import fit_motion_field
from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets, best_of, judge, with_past
from mnsf_ros.objects.motion_votes import voted_motions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.target import Target
from mnsf_ros.settings import ObjectSettings

# A rough guess needs few points.
_NUM_POINTS: Final = 12
_NUM_VOTED: Final = 2
# Motions over time that differ from the base by less than this are tried.
_MAX_CHANGE_M_S: Final = 12.0
_NUM_OVER_TIME: Final = 2
_NUM_ITERATIONS: Final = 3


def first_guesses(
    suspects: Suspects, targets: Targets, interval_s: float, settings: ObjectSettings
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns (K, 3) metres to the next sweep to start from, and (K,) if any is worth a fit.

    Args:
        suspects: K objects.
        targets: The other sweeps.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    no_motion = suspects.standing.motions
    if len(suspects) == 0:
        return no_motion, np.zeros(0, dtype=bool)
    some = suspects.objects.thinner(_NUM_POINTS)
    near = Targets(targets.near, past=())
    reach_m = settings.max_speed_m_s * interval_s
    voted = voted_motions(some, targets.near, reach_m, no_motion, _NUM_VOTED)
    by_near = judge(some, near, no_motion)
    standing = with_past(some, targets, by_near)
    nearly = best_of(some, near, by_near, voted)
    limit = standing.limit(nearly.motions)
    best = standing.better(with_past(some, targets, nearly, limit))
    if suspects.expected.is_known.any():
        best = best_of(some, targets, best, [suspects.expected.motions])
    if targets.past:
        over_time = _motions_over_time(some, targets.past, interval_s, best)
        best = best_of(some, targets, best, over_time)
    is_worth = suspects.expected.is_known | (best.total < standing.total)
    if not targets.past:
        is_worth[:] = True
    return best.motions, is_worth


def _motions_over_time(
    objects: ObjectPoints, past: Sequence[Target], interval_s: float, base: JudgedMotions
) -> list[NDArray[np.float32]]:
    """Returns motions (K, 3), metres to the next sweep, of objects relative to older sweeps.

    They are found for slow objects, and for long ones whose sides look alike.

    Args:
        objects: K objects.
        past: Older sweeps, the youngest first, at least one.
        interval_s: Time to the next sweep.
        base: Guesses that motions are searched around.
    """
    first = past[0]
    # In steps to an older sweep, so that the grid of the vote is fine enough.
    scaled = [replace(target, steps=target.steps / first.steps) for target in past]
    start = np.float32(first.steps) * base.motions
    reach_m = _MAX_CHANGE_M_S * interval_s * -first.steps
    return [
        fit_motion_field(objects, scaled[0], voted, _NUM_ITERATIONS).flows / np.float32(first.steps)
        for voted in voted_motions(objects, scaled, reach_m, start, _NUM_OVER_TIME)
    ]
