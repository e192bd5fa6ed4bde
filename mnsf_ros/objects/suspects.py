# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects may move: those that other sweeps do not support as static."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import JudgedMotions, judge
from mnsf_ros.objects.motion_memory import Expectation
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.target import Targets

# An object that an older sweep explains as well as this without motion is not a suspect.
_MIN_PAST_M: Final = 0.05
# The same for a neighbouring sweep, where there are no older ones.
_MIN_NEAR_M: Final = 0.025


@dataclass(frozen=True, eq=False)
class Suspects:
    """K objects that may move.

    Attributes:
        rows: (K,) int, which of all objects they are.
        objects: Their points.
        standing: How well they are explained as static.
        expected: What tracks expect of them.
    """

    rows: NDArray[np.int64]
    objects: ObjectPoints
    standing: JudgedMotions
    expected: Expectation

    @classmethod
    def among(cls, objects: ObjectPoints, targets: Targets, expected: Expectation) -> "Suspects":
        """Returns the objects that no older sweep supports as static, and those with a track.

        Without older sweeps they are those that no neighbouring sweep supports. A surface that
        one sweep does not show may be hidden.
        """
        some, limit_m = objects.thinner(), _MIN_PAST_M if targets.past else _MIN_NEAR_M
        is_suspect = np.ones(len(objects), dtype=bool)
        no_motion = np.zeros((len(objects), 3), np.float32)
        # The oldest first: it decides most objects, and few remain for the other sweeps.
        for target in reversed(targets.past or targets.near):
            open_ = is_suspect & ~expected.is_known
            left_m = target.residuals(some.only(open_), no_motion[open_])
            is_suspect[open_] = left_m > limit_m
        own = objects.only(is_suspect)
        standing = judge(own, targets, no_motion[is_suspect])
        return cls(np.flatnonzero(is_suspect), own, standing, expected.only(is_suspect))

    @property
    def has_past(self) -> bool:
        """Whether there are older sweeps."""
        return self.standing.past.shape[1] > 0

    def __len__(self) -> int:
        return len(self.rows)

    def are_first(self, number: int) -> NDArray[np.bool_]:
        """Returns a (K,) mask of what was seen to move, then the nearest ones, up to a number."""
        is_first = np.ones(len(self), dtype=bool)
        if len(self) > number:
            ranges = (self.objects.centers**2).sum(axis=1)
            is_first[np.lexsort((ranges, self.expected.scores <= 0))[number:]] = False
        return is_first

    def rather_than(self, moving: JudgedMotions, targets: Targets) -> "Suspects":
        """Returns them with what standing explains instead of motions.

        Where an object approaches or goes away it hides its own place in one of the neighbouring
        sweeps: if it moves, that is no excuse for the other hypothesis.
        """
        no_motion = np.zeros_like(moving.motions)
        standing = judge(self.objects, targets, no_motion, others=moving.motions)
        return replace(self, standing=standing)

    def only(self, wanted: NDArray[np.bool_]) -> "Suspects":
        """Returns the objects of the (K,) mask."""
        return Suspects(
            self.rows[wanted],
            self.objects.only(wanted),
            self.standing.only(wanted),
            self.expected.only(wanted),
        )
