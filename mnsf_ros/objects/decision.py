# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects move: all evidence in one number, and its limits."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.objects.motions import JudgedMotions, are_same, held_m, judge
from mnsf_ros.objects.object_points import NOISE_M, ObjectPoints
from mnsf_ros.objects.proposals import Proposals, Suspects
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.target import Targets
from mnsf_ros.settings import ObjectSettings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# Logistic regression, one number for each column of `evidence`: as `benchmarks/fit_weights.py`
# fits them to random worlds and KITTI, then balanced between found and false movers: the last, for
# parts, so that at the limit half of those that move alone do.
_WEIGHTS: Final = (-2.05, 0.9, 0.4, -3.1, -0.42, -0.18, 0.35, -2.0)
# Objects whose odds are lower than asked for by up to this (logarithm) are only followed.
_TENTATIVE: Final = 2.0


@dataclass(frozen=True, eq=False)
class Decision:
    """Which of the F objects that were fitted move.

    Attributes:
        proposals: What may move.
        moving: The motions that were found.
        free: (F,) see `free_space`.
        evidence: (F, E) features for and against their motions.
        scores: (F,) logarithm of the odds that they move.
        may_move: (F,) whether they are followed.
        held: (F,) metres, how well the motions of these are held, see `held_m`; 0 of others.
        seen: Those that are followed, together what moves together.
    """

    proposals: Proposals
    moving: JudgedMotions
    free: NDArray[np.float64]
    evidence: NDArray[np.float64]
    scores: NDArray[np.float64]
    may_move: NDArray[np.bool_]
    held: NDArray[np.float64]
    seen: Sightings

    @classmethod
    def of(cls, proposals: Proposals, moving: JudgedMotions, scene: Scene) -> "Decision":
        """Weighs the evidence.

        Args:
            proposals: What may move.
            moving: The motions of the F that were fitted.
            scene: The sweeps.
        """
        fitted, targets, current = proposals.fitted, scene.targets, scene.current
        objects, interval_s = fitted.objects, scene.usual_interval_s
        wholes = current.wholes[objects.numbers]
        standing = judge(objects, targets, np.zeros_like(moving.motions))
        free = free_space(objects, targets, moving.motions)
        features = evidence(fitted, standing, moving, free, wholes != objects.numbers)
        scores = moving_scores(features)
        may_move, is_moving = moves(
            objects.numbers, wholes, moving.motions, scores, interval_s, scene.settings
        )
        followed = objects.only(may_move)
        held = np.zeros(len(objects))
        held[may_move] = held_m(followed, moving.only(may_move), targets)
        seen = Sightings.of(
            followed,
            moving.motions[may_move],
            scores[may_move],
            is_moving[may_move],
            held[may_move],
            followed.all_points(current),
            current.pose.world_from_sensor,
            interval_s,
        )
        return cls(proposals, moving, free, features, scores, may_move, held, seen)

    @property
    def fitted(self) -> Suspects:
        """The F objects."""
        return self.proposals.fitted

    @cached_property
    def are_movers(self) -> NDArray[np.bool_]:
        """(those that are followed,) whether they are said to move.

        What goes along with a mover is a part of it.
        """
        return self.seen.are_moving[self.seen.groups]

    @cached_property
    def is_moving(self) -> NDArray[np.bool_]:
        """(F,) whether they are said to move."""
        is_moving = np.zeros(len(self.may_move), np.bool_)
        is_moving[self.may_move] = self.are_movers
        return is_moving

    @cached_property
    def movers(self) -> ObjectPoints:
        """The M objects that move."""
        return self.fitted.objects.only(self.is_moving)

    @property
    def groups(self) -> NDArray[np.int64]:
        """(M,) the number from 0 of the thing that each of the movers is a part of."""
        of_movers = self.seen.groups[self.are_movers]
        return np.unique(of_movers, return_inverse=True)[1]

    @cached_property
    def doubtful(self) -> Suspects:
        """Suspects that are not called dynamic, with those beyond the limits of the work."""
        suspects = self.proposals.suspects
        return suspects.only(~np.isin(suspects.objects.numbers, self.movers.numbers))


def moving_scores(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns (K,) logarithm of the odds that objects with some evidence (K, 8) move."""
    return (features * np.asarray(_WEIGHTS)).sum(axis=1)


def free_space(
    objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Returns (K,) how many more points are in free space of another sweep if objects stand.

    These are the points of an object that are there if it stands, less those if it moves, and the
    points that older sweeps had of it, if it moves, and that are gone: beside a part, none of its
    whole. A place that was seen through is evidence of motion. One that was hidden, or beside the
    beams, is none: there a static object leaves a residual, too.

    Args:
        objects: K objects.
        targets: The other sweeps.
        motions: (K, 3) metres, to the next sweep.
    """
    current = targets.near[0].current
    rows = objects.rows_of(current.num_objects)[current.thinned_objects]
    points, owners = chosen_points(current.thinned, rows >= 0), rows[rows >= 0]
    free = np.zeros(len(objects))
    for target in (*targets.past, *targets.near):
        free += target.num_free(objects, np.zeros_like(motions))
        free -= target.num_free(objects, motions)
    for target in targets.past or targets.near:
        places = points + np.take(target.shifts(objects, motions), owners, axis=0)
        free += np.bincount(owners[target.rows_of_gone(places)], minlength=len(objects))
    return free


def evidence(
    suspects: Suspects,
    standing: JudgedMotions,
    moving: JudgedMotions,
    free: NDArray[np.float64],
    are_parts: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Returns (K, 8) features for and against the motions of K objects.

    These are: 1; the logarithm of the number of points in free space; the odds so far; the
    logarithm of one metre more than a motion that no track expected. And the logarithm of the share
    of the residual that the motion leaves in the neighbouring sweeps, plus that of the older ones,
    or of the neighbouring ones once more where there are none: times the logarithm of the
    thickness, times that of the number of points, and times the metres from the sensor up to its
    top. And whether it is a part: most move with their wholes. Free space says nothing of those,
    as that their places were free is why they are parts.

    Args:
        suspects: K objects, and what tracks expect of them.
        standing: How well they are explained as static.
        moving: How well their motions explain them.
        free: (K,) see `free_space`.
        are_parts: (K,) whether they were cut out of other objects.
    """
    objects, expected = suspects.objects, suspects.expected
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    is_same = expected.is_known & are_same(moving.motions, expected.motions)
    shares = _log_share(moving.cost, standing.cost) + _log_share(moving.older, standing.older)
    thicknesses = np.log1p(objects.thicknesses / NOISE_M)
    columns = (
        np.ones(len(suspects)),
        np.log1p(np.where(are_parts, 0.0, np.maximum(free, 0.0))),
        expected.scores,
        np.log1p(lengths) * ~is_same,
        shares * thicknesses,
        shares * np.log(objects.counts),
        shares * objects.tops,
        are_parts,
    )
    return np.stack(columns, axis=1).astype(np.float64)


def _log_share(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.log((part + NOISE_M) / (whole + NOISE_M))


def moves(
    numbers: NDArray[np.int64],
    wholes: NDArray[np.int64],
    motions: NDArray[np.float32],
    scores: NDArray[np.float64],
    interval_s: float,
    settings: ObjectSettings,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns masks (K,) of the objects that may move and are followed, and of those that move.

    Of a part and its whole the likelier one does: the whole stands, or the part goes along.

    Args:
        numbers: (K,) the objects.
        wholes: (K,) what each of them was cut out of, else itself.
        motions: (K, 3) metres, to the next sweep.
        scores: (K,) logarithm of the odds that they move, see `moving_scores`.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    are_parts = wholes != numbers
    lengths = np.hypot(motions[:, 0], motions[:, 1])
    is_possible = lengths > NOISE_M / USUAL_INTERVAL_S * interval_s
    is_possible &= lengths <= settings.max_speed_m_s * interval_s
    limit = np.log(settings.min_probability / (1 - settings.min_probability))
    may_move = is_possible & (scores > limit - _TENTATIVE)
    alone, best = are_parts & may_move, np.full(numbers.max(initial=0) + 1, -np.inf)
    np.maximum.at(best, wholes[alone], scores[alone])
    may_move &= are_parts | (scores >= best[numbers])
    may_move &= ~are_parts | ~np.isin(wholes, numbers[may_move])
    return may_move, may_move & (scores > limit)
