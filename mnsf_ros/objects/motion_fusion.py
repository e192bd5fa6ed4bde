# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fusion: the best of forward flow, inverted backward flow and their mean for all sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_field import MotionField
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.point_grid import PointGrids
from mnsf_ros.objects.target import TRUNCATION_M, Target

# A candidate must be better by this much to replace an earlier one: noise must not decide.
_MIN_BETTER_M: Final = 0.0025
# So must one that was not fitted to the neighbouring sweeps: over a longer time nothing moves
# evenly.
_MAX_SHARE: Final = 0.8
# Of a vertical motion so much is noise: what lies between two beams of a lidar is not seen.
_LEVEL_M: Final = 0.05
# To choose among candidates, a third of the points is enough.
_POINTS_TO_CHOOSE: Final = 16


@dataclass(frozen=True, eq=False)
class JudgedMotions:
    """Motions of K objects, and how well they explain the other sweeps.

    Attributes:
        motions: (K, 3) float32, metres, over ground, to the next sweep.
        near: (K, 2) metres, unexplained by the next and by the previous sweep, see
            `Target.unexplained`; (K, 1) without a previous one.
        past: (K, 1) metres, unexplained by an older sweep; (K, 0) without one.
        disagreement: (K,) metres, between forward and inverted backward flow.
    """

    motions: NDArray[np.float32]
    near: NDArray[np.float64]
    past: NDArray[np.float64]
    disagreement: NDArray[np.float32]

    @cached_property
    def total(self) -> NDArray[np.float64]:
        """(K,) metres, the cost and the mean residual in older sweeps."""
        past = self.past.mean(axis=1) if self.past.shape[1] else 0.0
        total: NDArray[np.float64] = self.cost + past
        return total

    @cached_property
    def cost(self) -> NDArray[np.float64]:
        """(K,) metres, the mean residual in the next and the previous sweep."""
        cost: NDArray[np.float64] = self.near.mean(axis=1)
        return cost

    def only(self, wanted: NDArray[np.bool_]) -> JudgedMotions:
        """Returns the objects of the (K,) mask."""
        return JudgedMotions(
            self.motions[wanted], self.near[wanted], self.past[wanted], self.disagreement[wanted]
        )

    def limit(self, motions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Returns (K,) metres; `motions` (K, 3) are better if they leave less, see `better`."""
        is_same = (motions == self.motions).all(axis=1)
        return np.where(is_same, -np.inf, self.total - _MIN_BETTER_M)

    def better(self, other: JudgedMotions) -> JudgedMotions:
        """Returns for each object its own motion, or the other one if that is clearly better."""
        wins = other.total < self.limit(other.motions)
        return JudgedMotions(
            np.where(wins[:, None], other.motions, self.motions),
            np.where(wins[:, None], other.near, self.near),
            np.where(wins[:, None], other.past, self.past),
            np.where(wins, other.disagreement, self.disagreement),
        )


@dataclass(frozen=True)
class Targets:
    """The sweeps that motions are measured on.

    Attributes:
        near: Next sweep, and previous sweep where there is one.
        past: An older sweep, where there is one.
    """

    near: Sequence[Target]
    past: Sequence[Target]

    @cached_property
    def grids(self) -> PointGrids:
        """The points of all of them."""
        targets = (*self.near, *self.past)
        grids = [target.sweep.grid for target in targets]
        transforms = [target.from_current for target in targets]
        return PointGrids(grids, transforms, len(self.near), TRUNCATION_M)

    def shifts(self, objects: ObjectPoints, candidates: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns (T, C, K, 3) metres, how far objects have moved by the time of each target.

        Args:
            objects: K objects.
            candidates: (C, K, 3) metres, motions to the next sweep.
        """
        targets = (*self.near, *self.past)
        return np.stack([target.shifts(objects, candidates) for target in targets])


def judge(
    objects: ObjectPoints,
    targets: Targets,
    motions: NDArray[np.float32],
    disagreement: NDArray[np.float32] | None = None,
    limit: NDArray[np.float64] | None = None,
) -> JudgedMotions:
    """Returns motions (K, 3) with their residuals on all targets.

    Args:
        objects: K objects.
        targets: The other sweeps.
        motions: (K, 3) metres, to the next sweep.
        disagreement: (K,) metres, 0 if not given.
        limit: (K,) metres; motions whose total is above need no exact residuals.
    """
    if disagreement is None:
        disagreement = np.zeros(len(objects), np.float32)
    if not (targets.near or targets.past):
        none = np.zeros((len(objects), 0))
        return JudgedMotions(motions, none, none, disagreement)
    limits = np.full(len(objects), np.inf) if limit is None else limit
    shifts = targets.shifts(objects, motions[None])
    residuals = targets.grids.residuals(objects.as_columns, shifts, limits)
    return _with_residuals(targets, motions, residuals, disagreement)


def with_past(
    objects: ObjectPoints,
    targets: Targets,
    judged: JudgedMotions,
    limit: NDArray[np.float64] | None = None,
) -> JudgedMotions:
    """Returns motions that were judged by the neighbouring sweeps, with residuals in older ones."""
    left = None if limit is None else limit - judged.cost
    past = judge(objects, Targets((), targets.past), judged.motions, limit=left).past
    return replace(judged, past=past)


def best_of(
    objects: ObjectPoints,
    targets: Targets,
    first: JudgedMotions,
    others: Iterable[NDArray[np.float32]],
    share: float = 1.0,
) -> JudgedMotions:
    """Returns for each object the best of several motions, the first if in doubt.

    Args:
        objects: K objects.
        targets: What motions are measured on.
        first: Motions that were judged.
        others: (K, 3) metres each, further candidates.
        share: They must leave less than this share of the residual.
    """
    tried = [*others]
    if not tried:
        return first
    candidates = np.stack(tried)
    motions, residuals = targets.grids.choose(
        objects.as_columns,
        first.motions,
        np.concatenate([first.near, first.past], axis=1),
        candidates,
        targets.shifts(objects, candidates),
        share,
        _MIN_BETTER_M,
    )
    return _with_residuals(targets, motions, residuals, first.disagreement)


def _with_residuals(
    targets: Targets,
    motions: NDArray[np.float32],
    residuals: NDArray[np.float64],
    disagreement: NDArray[np.float32],
) -> JudgedMotions:
    """Returns motions (K, 3) with their residuals (K, T) on all targets."""
    near, past = np.split(residuals, [len(targets.near)], axis=1)
    return JudgedMotions(motions, near, past, disagreement)


def fuse_motions(
    objects: ObjectPoints,
    targets: Targets,
    forward: MotionField,
    backward: MotionField,
    inverted: NDArray[np.float32],
    others: Sequence[NDArray[np.float32]] = (),
) -> JudgedMotions:
    """Makes one motion of two (section 3 of the paper; here without a network).

    Args:
        objects: K objects.
        targets: What the candidates are measured on.
        forward: The forward field.
        backward: The backward field.
        inverted: (K, 3) metres, the inverted backward flow.
        others: (K, 3) metres each, further candidates.
    """
    forward, inverted = replace(forward, flows=_levelled(forward.flows)), _levelled(inverted)
    weight = forward.num_matched / np.maximum(forward.num_matched + backward.num_matched, 1)
    weight = weight[:, None].astype(np.float32)
    mean = weight * forward.flows + (1 - weight) * inverted
    disagreement = np.sqrt(((forward.flows - inverted) ** 2).sum(axis=1))
    some = objects.thinner(_POINTS_TO_CHOOSE)
    near = Targets(targets.near, past=())
    fitted = best_of(some, near, judge(some, near, mean), (forward.flows, inverted))
    best = best_of(some, targets, with_past(some, targets, fitted), others, _MAX_SHARE)
    return judge(objects, targets, best.motions, disagreement)


def _levelled(motions: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns motions (K, 3) in metres without as much of their vertical part as may be noise."""
    level = motions.copy()
    level[:, 2] -= np.clip(motions[:, 2], -_LEVEL_M, _LEVEL_M)
    return level
