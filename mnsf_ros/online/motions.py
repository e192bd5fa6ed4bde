# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Motions of objects: fitted to one sweep, judged on all, and the best of several (fusion)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import expit

from mnsf_ros.arrays import AnyFloats, Bools, Floats, Floats32
from mnsf_ros.online.object_points import NOISE_M, ObjectPoints, Rows
from mnsf_ros.online.target import NUM_ITERATIONS, Target, Targets

# Nearest points underestimate motion along surfaces: longer steps converge sooner.
_OVER_RELAXATION: Final = 1.8
# A motion that was not fitted to the neighbouring sweeps must cost less than this share of the
# fitted one: over a longer time velocities change, most of all when a vehicle brakes.
_NOT_FITTED_SHARE: Final = 0.8
# A motion of this prior cost must have a residual smaller by a factor of e.
_PRIOR_SCALE: Final = 6.0
# A motion shifted by this should have a larger residual; along a flat side it does not.
_SHIFT_M: Final = 0.2
# Motions are the same if they differ by less than this share of the longer one plus a metre.
_SAME_SHARE: Final = 0.1


@dataclass(frozen=True, eq=False)
class TrackPrior(Rows):
    """What tracks predict of K objects: the prior of their motions.

    Attributes:
        shares: (K,) share of an object's points that lie where its track predicts them; 0 without a
            track.
        motions: (K, 3) float32, metres to the next sweep; 0 for objects without a track.
        turn_rates: (K,) radians per second; 0 without a track.
        log_odds: (K,) that their track moves; 0 without one.
        deviations_m: (K,) standard deviation of the motions along each axis; 1 without a track.
    """

    shares: Floats
    motions: Floats32
    turn_rates: Floats
    log_odds: Floats
    deviations_m: Floats

    @classmethod
    def without_tracks(cls, num_objects: int) -> "TrackPrior":
        """Returns the prior of so many objects without tracks."""
        nothing, motions = np.zeros(num_objects), np.zeros((num_objects, 3), np.float32)
        return cls(nothing, motions, nothing, nothing, np.ones(num_objects))

    @property
    def has_track(self) -> Bools:
        """(K,) whether an object has a track."""
        return self.shares > 0

    def cost(self, motions: Floats32) -> Floats:
        """Returns (K,) the prior costs of motions (K, 3), metres: their negative log-likelihood.

        A moving track predicts its object's motion within the errors of the track. If the track
        does not move, or predicts no more than half of the object's points, all motions are equally
        likely and the cost is 0, as it is without a track.
        """
        moves = expit(self.log_odds) * (self.shares > 0.5)
        apart = ((motions - self.motions)[:, :2] ** 2).sum(axis=1) / self.deviations_m**2
        return np.asarray(-np.log(moves * np.exp(-apart / 2) + 1 - moves), np.float64)

    def candidates(self, motions: Floats32) -> list[Floats32]:
        """Returns (K, 3) metres each: the given motions, and the predictions if there are any."""
        if not self.has_track.any():
            return [motions]
        return [motions, np.where(self.has_track[:, None], self.motions, motions)]


@dataclass(frozen=True, eq=False)
class JudgedMotions(Rows):
    """Motions of K objects, and how well they explain the other sweeps.

    Attributes:
        motions: (K, 3) float32, metres, over ground, to the next sweep.
        near: (K, 2) metres, residuals in the next and the previous sweep, see
            `Target.residuals`; (K, 1) without a previous one.
        past: (K, P) metres, residuals in P older sweeps.
    """

    motions: Floats32
    near: Floats
    past: Floats

    @cached_property
    def total(self) -> Floats:
        """(K,) metres, the sum of `near_mean` and `past_mean`."""
        return self.near_mean + self.past_mean

    @cached_property
    def near_mean(self) -> Floats:
        """(K,) metres, the mean residual in the next and the previous sweep."""
        return self.near.mean(axis=1)

    @property
    def past_mean(self) -> Floats:
        """(K,) metres, the mean residual in older sweeps; without older ones, `near_mean`."""
        return self.past.mean(axis=1) if self.past.shape[1] else self.near_mean

    def posterior_cost(self, prior: TrackPrior) -> Floats:
        """Returns (K,) metres, total residual plus noise, times a factor for the prior cost."""
        excess = np.exp(prior.cost(self.motions) / _PRIOR_SCALE)
        return np.asarray((self.total + 2 * NOISE_M) * excess, np.float64)

    def better(
        self, other: "JudgedMotions", prior: TrackPrior, share: float = 1.0
    ) -> "JudgedMotions":
        """Returns for each object its own motion, or the other one if that is more likely.

        The other motion wins if its posterior cost is less than `share` times the own one.
        """
        wins = other.posterior_cost(prior) < share * self.posterior_cost(prior)
        return JudgedMotions(
            np.where(wins[:, None], other.motions, self.motions),
            np.where(wins[:, None], other.near, self.near),
            np.where(wins[:, None], other.past, self.past),
        )


def are_same(motions: AnyFloats, others: AnyFloats) -> Bools:
    """Returns (K,) whether motions (K, 3) are as good as others (K, 3), both in metres."""
    apart = np.sqrt(((motions - others) ** 2).sum(axis=1))
    longer = np.sqrt(np.maximum((motions**2).sum(axis=1), (others**2).sum(axis=1)))
    return apart < _SAME_SHARE * (1.0 + longer)


def fit_motion_field(objects: ObjectPoints, target: Target, start: Floats32) -> Floats32:
    """The forward and the backward field: moves each object until it lies on the target.

    Returns (K, 3) metres, from the current sweep to the target, after the interval between their
    stamps.

    Args:
        objects: K objects of the current sweep.
        target: The sweep at t+1 for the forward field, at t-1 for the backward field.
        start: (K, 3) metres, motion to the next sweep to start from.
    """
    ratios = target.time_ratios_of(objects, start)
    slopes = target.current.ground.slopes(objects.centers)
    flows = ratios * start
    for _ in range(NUM_ITERATIONS):
        flows[:, 2] = (slopes * flows[:, :2]).sum(axis=1)
        flows += (_OVER_RELAXATION * target.pulls(objects, flows)).astype(np.float32)
    flows[:, 2] = (slopes * flows[:, :2]).sum(axis=1)
    return np.asarray(flows * (np.float32(target.time_ratio) / ratios), np.float32)


def judge(
    objects: ObjectPoints, targets: Targets, motions: Floats32, max_total_m: Floats | float = np.inf
) -> JudgedMotions:
    """Returns motions (K, 3) with their residuals on all targets.

    Args:
        objects: K objects.
        targets: The other sweeps.
        motions: (K, 3) metres, to the next sweep.
        max_total_m: (K,) metres; totals above are infinite.
    """
    sweeps = (*targets.near, *targets.past)
    residuals = np.empty((len(objects), len(sweeps)))
    # Each residual takes its share of what the total may still reach: the next ones stop sooner.
    budget_m = np.broadcast_to(max_total_m, len(objects))
    for column, target in enumerate(sweeps):
        num_in_mean = len(targets.near) if column < len(targets.near) else len(targets.past)
        residuals[:, column] = target.residuals(objects, motions, num_in_mean * budget_m)
        budget_m = budget_m - residuals[:, column] / num_in_mean
    residuals[budget_m < 0] = np.inf
    near, past = np.split(residuals, [len(targets.near)], axis=1)
    return JudgedMotions(motions, near, past)


def best_of(
    objects: ObjectPoints,
    targets: Targets,
    first: JudgedMotions,
    others: Sequence[Floats32],
    prior: TrackPrior,
) -> JudgedMotions:
    """Returns for each object the best of several motions, the first if in doubt.

    Args:
        objects: K objects.
        targets: The other sweeps.
        first: Judged motions.
        others: (K, 3) metres each, further candidates.
        prior: Of motions.
    """
    tried = np.stack([first.motions, *others])
    are_again = [
        (tried[:row] == tried[row]).all(axis=2).any(axis=0) for row in range(1, len(tried))
    ]
    excess = np.exp(np.concatenate([prior.cost(each) for each in others]) / _PRIOR_SCALE)
    max_total_m = np.tile(first.posterior_cost(prior), len(others)) / excess - 2 * NOISE_M
    motions, new = np.concatenate(others), np.flatnonzero(~np.concatenate(are_again))
    objects = objects.repeated(len(others)).select(new)
    found = judge(objects, targets, motions[new], max_total_m[new])
    near, past = (
        np.full((len(motions), part.shape[1]), np.inf) for part in (found.near, found.past)
    )
    near[new], past[new] = found.near, found.past
    judged = JudgedMotions(motions, near, past)
    for rows in np.arange(len(judged.motions)).reshape(len(others), -1):
        first = first.better(judged.select(rows), prior)
    return first


def fuse_motions(
    objects: ObjectPoints,
    targets: Targets,
    forward: Floats32,
    inverted: Floats32 | None,
    others: Sequence[Floats32],
    prior: TrackPrior,
) -> JudgedMotions:
    """Makes one motion of two (section 3 of the paper; here without a network).

    Args:
        objects: K objects.
        targets: The other sweeps.
        forward: (K, 3) metres, the forward flow.
        inverted: (K, 3) metres, the inverted backward flow; None without a previous sweep.
        others: (K, 3) metres each, further candidates.
        prior: Of motions.
    """
    if inverted is None:
        return best_of(objects, targets, judge(objects, targets, forward), others, prior)
    mean = np.float32(0.5) * (forward + inverted)
    fitted = best_of(objects, targets, judge(objects, targets, mean), (forward, inverted), prior)
    best = best_of(objects, targets, fitted, others, prior)
    return fitted.better(best, prior, _NOT_FITTED_SHARE)


def residual_rise_m(objects: ObjectPoints, fitted: JudgedMotions, targets: Targets) -> Floats:
    """Returns (K,) metres, the smallest rise of the residual when the motion is shifted.

    The shifts are along and across the object. For a flat side that can slide along itself the
    rise is 0: the motion is a guess.
    """
    angles = np.arange(4)[:, None] * (np.pi / 2) + objects.angles
    motions = np.tile(fitted.motions, (5, 1, 1))
    motions[1:, :, 0] += (_SHIFT_M * np.cos(angles)).astype(np.float32)
    motions[1:, :, 1] += (_SHIFT_M * np.sin(angles)).astype(np.float32)
    judged = judge(objects.thinner().repeated(5), targets, motions.reshape(-1, 3))
    own, *others = judged.total.reshape(5, len(objects))
    return np.maximum(np.min(others, axis=0) - own, 0.0)
