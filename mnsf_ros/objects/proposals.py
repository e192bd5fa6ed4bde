# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Proposals: what may move by itself, and about how."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import StageClock
from mnsf_ros.objects.motion_memory import Expectation
from mnsf_ros.objects.motions import CLEARLY_SHARE, JudgedMotions, best_of, judge
from mnsf_ros.objects.object_points import NOISE_M, ObjectPoints
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.target import Targets
from mnsf_ros.objects.voting import voted_motions

# K objects, the sweeps, and the clock of the estimate, to what `first_guesses` returns.
Guesses = Callable[["Suspects", Scene, StageClock], tuple[NDArray[np.float32], NDArray[np.bool_]]]

# In older sweeps, motions that differ from the best in the neighbouring ones by less are tried: the
# work grows with the square.
_MAX_CHANGE_M_S: Final = 12.0


@dataclass(frozen=True, eq=False)
class Proposals:
    """What may move, and where the fits of its motion start.

    Attributes:
        suspects: Objects that other sweeps do not support as static, and those with a track.
        searched: The K of them whose motion was searched: seen to move, then the nearest ones.
        start: (K, 3) metres to the next sweep, the guesses of the method.
        are_worth: (K,) whether a motion may explain them better.
    """

    suspects: "Suspects"
    searched: "Suspects"
    start: NDArray[np.float32]
    are_worth: NDArray[np.bool_]

    @classmethod
    def of(cls, scene: Scene, guesses: Guesses, clock: StageClock) -> "Proposals":
        """Returns those of the current sweep, with a method's guesses of their motions."""
        with clock.stage("objects"):
            objects = ObjectPoints.of(scene.current, scene.settings)
            pose = scene.current.pose.world_from_sensor
            expected = Expectation.of(objects, scene.tracks, pose, scene.interval_s)
            suspects = Suspects.among(objects, scene.targets, expected)
            searched = suspects.only(suspects.are_first(scene.settings.max_suspects))
        return cls(suspects, searched, *guesses(searched, scene, clock))

    @cached_property
    def fitted(self) -> "Suspects":
        """The F objects that a motion may explain better."""
        return self.searched.only(self.are_worth)


@dataclass(frozen=True, eq=False)
class Suspects:
    """K objects that may move.

    Attributes:
        objects: Their points.
        standing: How well a few points of each are explained as static.
        expected: What tracks expect of them.
    """

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
        return cls(objects.only(is_suspect), standing, expected.only(is_suspect))

    def __len__(self) -> int:
        return len(self.objects)

    def are_first(self, number: int) -> NDArray[np.bool_]:
        """Returns a (K,) mask of what was seen to move, then the nearest ones, up to a number."""
        is_first = np.ones(len(self), dtype=bool)
        if len(self) > number:
            ranges = (self.objects.centers**2).sum(axis=1)
            is_first[np.lexsort((ranges, self.expected.scores <= 0))[number:]] = False
        return is_first

    def are_worth(self, moving: JudgedMotions, scene: Scene) -> NDArray[np.bool_]:
        """Returns a (K,) mask of those that motions explain clearly better, or that have a track.

        Without older sweeps all are: two sweeps alone do not tell.
        """
        explains = moving.total < CLEARLY_SHARE * self.standing.total
        return self.expected.is_known | explains | (not scene.targets.past)

    def only(self, wanted: NDArray[np.bool_]) -> "Suspects":
        """Returns the objects of the (K,) mask."""
        objects, standing = self.objects.only(wanted), self.standing.only(wanted)
        return Suspects(objects, standing, self.expected.only(wanted))


def first_guesses(
    suspects: Suspects, scene: Scene, clock: StageClock
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns (K, 3) metres to the next sweep to start from, and (K,) if any is worth a fit.

    The shift with most votes of the neighbouring sweeps and what a track expects are compared, then
    that of the older sweeps around the best of them: for slow objects, and for long ones whose
    sides look alike.

    Args:
        suspects: K objects.
        scene: The sweeps.
        clock: Of the estimate.
    """
    with clock.stage("first guess"):
        if len(suspects) == 0:
            return suspects.standing.motions, np.zeros(0, dtype=bool)
        expected = suspects.expected
        some, best = suspects.objects.thinner(), suspects.standing
        targets, interval_s = scene.targets, scene.usual_interval_s
        reach_m, changed_m = scene.settings.max_speed_m_s * interval_s, _MAX_CHANGE_M_S * interval_s
        voted = voted_motions(some, targets.near, reach_m, best.motions)
        best = best_of(some, targets, best, expected.beside(voted), expected.surprise)
        if targets.past:
            voted = voted_motions(some, targets.past, changed_m, best.motions)
            best = best_of(some, targets, best, [voted], expected.surprise)
        return best.motions, suspects.are_worth(best, scene)
