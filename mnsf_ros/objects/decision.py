# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Decision of an estimate about the objects of a sweep, and its evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.visibility import Visibility


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
        scores: (F,) logarithm of the odds that they move.
        may_move: (F,) whether they are worth following.
        is_moving: (F,) whether they are said to move.
    """

    suspects: Suspects
    searched: Suspects
    start: NDArray[np.float32]
    fitted: Suspects
    moving: JudgedMotions
    seen: Visibility
    scores: NDArray[np.float64]
    may_move: NDArray[np.bool_]
    is_moving: NDArray[np.bool_]

    @property
    def num_left_out(self) -> int:
        """How many suspects were beyond the limits of the work."""
        return len(self.suspects) - len(self.searched)

    @property
    def doubtful(self) -> Suspects:
        """Suspects that are not called dynamic, with those beyond the limits of the work."""
        return self.suspects.only(~np.isin(self.suspects.rows, self.fitted.rows[self.is_moving]))
