# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Decision of an estimate about the objects of a sweep, its evidence, and its limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.evidence import Visibility, moving_scores
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.suspects import MIN_PAST_M, Suspects
from mnsf_ros.settings import ObjectSettings


@dataclass(frozen=True, eq=False)
class Decision:
    """Each step leaves fewer objects: suspects, those searched, those fitted, those that move.

    Attributes:
        suspects: Objects that other sweeps do not support as static.
        searched: The K of them whose motion was searched: the nearest ones.
        start: (K, 3) metres to the next sweep, where the fits of their motions started.
        fitted: The F of these that a motion may explain better.
        moving: The motions that were found.
        seen: What the other sweeps could see of them.
        evidence: (F, E) features for and against their motions.
        may_move: (F,) whether they are worth following.
        is_moving: (F,) whether they are said to move.
    """

    suspects: Suspects
    searched: Suspects
    start: NDArray[np.float32]
    fitted: Suspects
    moving: JudgedMotions
    seen: Visibility
    evidence: NDArray[np.float64]
    may_move: NDArray[np.bool_]
    is_moving: NDArray[np.bool_]

    @cached_property
    def scores(self) -> NDArray[np.float64]:
        """(F,) logarithm of the odds that they move."""
        return moving_scores(self.evidence)

    @property
    def num_left_out(self) -> int:
        """How many suspects were beyond the limits of the work."""
        return len(self.suspects) - len(self.searched)

    @property
    def doubtful(self) -> Suspects:
        """Suspects that are not called dynamic, with those beyond the limits of the work."""
        return self.suspects.only(~np.isin(self.suspects.rows, self.fitted.rows[self.is_moving]))


# A shorter motion over ground is noise.
_MIN_MOTION_M: Final = 0.02
# Objects whose odds are lower than asked for by up to this (logarithm) are only followed.
_TENTATIVE: Final = 2.0


def moves(
    suspects: Suspects,
    moving: JudgedMotions,
    scores: NDArray[np.float64],
    interval_s: float,
    settings: ObjectSettings,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns masks (K,) of objects that may move, and of those called dynamic.

    Args:
        suspects: K objects, how well they are explained as static, and what tracks expect of them.
        moving: How well their motions explain them.
        scores: (K,) logarithm of the odds that they move, see `moving_scores`.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    standing = suspects.standing
    lengths = np.hypot(moving.motions[:, 0], moving.motions[:, 1])
    is_slow_enough = lengths <= settings.max_speed_m_s * interval_s
    may_move = moving.total < settings.max_unexplained * standing.total
    may_move &= (lengths > _MIN_MOTION_M) & is_slow_enough
    odds = settings.min_probability / (1 - settings.min_probability)
    is_clear = may_move & (scores > np.log(odds))
    # What was clearly seen to move goes on, also slower, until standing explains as much.
    evidence = suspects.expected.evidence
    is_held = (evidence > 0) & (evidence + scores > 0) & (moving.total < standing.total)
    is_held &= (lengths > _MIN_MOTION_M / 2) & is_slow_enough
    is_held &= standing.past.max(axis=1, initial=0.0) > MIN_PAST_M
    return is_held | may_move & (scores > np.log(odds) - _TENTATIVE), is_held | is_clear
