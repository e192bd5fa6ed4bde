# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects may move: those that other sweeps do not support as static."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_memory import Expectation
from mnsf_ros.objects.motions import JudgedMotions, judge
from mnsf_ros.objects.object_points import NOISE_M, ObjectPoints
from mnsf_ros.objects.target import Targets


@dataclass(frozen=True, eq=False)
class Suspects:
    """K objects that may move.

    Attributes:
        rows: (K,) int, which of all objects they are.
        objects: Their points.
        standing: How well a few points of each are explained as static.
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
        one sweep does not show may be hidden. And those beside which something is gone: of a long
        side that slides along itself only the ends change.
        """
        some, others = objects.thinner(), targets.past or targets.near
        is_suspect = np.ones(len(objects), dtype=bool)
        no_motion = np.zeros((len(objects), 3), np.float32)
        # The oldest first: it decides most objects, and few remain for the other sweeps.
        for target in reversed(others):
            open_ = is_suspect & ~expected.is_known
            left_m = target.residuals(some.only(open_), no_motion[open_])
            # What a sweep explains up to its noise without motion is no suspect.
            is_suspect[open_] = left_m > 2 * NOISE_M
        changed = np.concatenate([target.objects_beside_gone for target in others])
        is_suspect |= np.isin(objects.numbers, changed)
        standing = judge(some.only(is_suspect), targets, no_motion[is_suspect])
        rows, own = np.flatnonzero(is_suspect), objects.only(is_suspect)
        return cls(rows, own, standing, expected.only(is_suspect))

    def __len__(self) -> int:
        return len(self.rows)

    def are_first(self, number: int) -> NDArray[np.bool_]:
        """Returns a (K,) mask of what was seen to move, then the nearest ones, up to a number."""
        is_first = np.ones(len(self), dtype=bool)
        if len(self) > number:
            ranges = (self.objects.centers**2).sum(axis=1)
            is_first[np.lexsort((ranges, self.expected.scores <= 0))[number:]] = False
        return is_first

    def only(self, wanted: NDArray[np.bool_]) -> "Suspects":
        """Returns the objects of the (K,) mask."""
        return Suspects(
            self.rows[wanted],
            self.objects.only(wanted),
            self.standing.only(wanted),
            self.expected.only(wanted),
        )
