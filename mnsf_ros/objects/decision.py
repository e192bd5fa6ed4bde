# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects move: all evidence in one number, and its limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.objects.motion_fusion import JudgedMotions, are_same
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.range_view import margin_m
from mnsf_ros.objects.suspects import MIN_PAST_M, Suspects
from mnsf_ros.objects.target import Target, Targets
from mnsf_ros.settings import ObjectSettings

# Not fitted: the number of places where something may match by chance grows with the square of the
# motion, unless a track expected it. Simulated streets have fewer such places than real ones.
_PER_LOG: Final = -2.0
# Logistic regressions; `python benchmarks/fit_weights.py` prints the numbers. For each column of
# `evidence`: constant, logarithm of the share of the residual in the neighbouring sweeps that the
# motion leaves, of the number of points in free space, agreement with a track, and with what score
# of that, logarithm of the thickness; with older sweeps: gain in metres there if the motion is
# slow, gain where the place was free, logarithm of the share that the motion leaves;
# without them: logarithm of the metres from one on if no track expected the motion.
_WITH_PAST: Final = (-2.07, -0.87, 0.90, 1.72, 0.31, 0.72, 12.32, 1.24, -0.41)
_WITHOUT_PAST: Final = (-1.05, -1.00, 1.18, 2.85, 1.41, 1.05, _PER_LOG)
# Below these, residuals are noise: of the neighbouring sweeps, and of the older ones.
_NOISE_M: Final = 0.01
_PAST_NOISE_M: Final = 0.02
# The longest motion that is slow, to the next sweep.
_SLOW_M: Final = 0.3
# By noise alone surfaces are thicker than this.
_THIN_M: Final = 0.03


@dataclass(frozen=True, eq=False)
class Visibility:
    """Shares of K objects that are in free space of other sweeps, or hidden in them.

    A place that was seen through is evidence of motion. A place that was hidden, or beside the
    beams, is none: there a static object leaves a residual, too.

    Attributes:
        free: (K,) share of each object's points that are in free space of a sweep if the object is
            static, summed over the sweeps, less the same if it moves.
        free_past: (K, S) share of its points that are in free space of each of S older sweeps if
            it is static.
        hidden: (K,) share of its points that are hidden in a sweep if it is static, mean over the
            sweeps.
    """

    free: NDArray[np.float64]
    free_past: NDArray[np.float64]
    hidden: NDArray[np.float64]

    @classmethod
    def of(
        cls, objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
    ) -> Visibility:
        """Returns the visibility in the targets of K objects with motions (K, 3), metres."""
        free = np.zeros(len(objects))
        free_past = np.zeros((len(objects), len(targets.past)))
        hidden = np.zeros(len(objects))
        sweeps = (*targets.past, *targets.near)
        for number, target in enumerate(sweeps):
            is_free, is_hidden = target.seen(objects, np.zeros_like(motions))
            free += is_free - target.seen(objects, motions)[0]
            hidden += is_hidden / len(sweeps)
            if number < len(targets.past):
                free_past[:, number] = is_free
        return cls(free, free_past, hidden)


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
        is_moving: (F,) whether they are said to move.
    """

    suspects: Suspects
    searched: Suspects
    start: NDArray[np.float32]
    fitted: Suspects
    moving: JudgedMotions
    seen: Visibility
    evidence: NDArray[np.float64]
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


def moving_scores(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns (K,) logarithm of the odds that objects with some evidence (K, F) move."""
    weights = _WITH_PAST if features.shape[1] == len(_WITH_PAST) else _WITHOUT_PAST
    scores: NDArray[np.float64] = (features * np.asarray(weights)).sum(axis=1)
    return scores


def evidence(
    suspects: Suspects, moving: JudgedMotions, seen: Visibility, are_parts: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Returns (K, F) features for and against the motions of K objects.

    Free space says nothing of a part of a long object: that its place was free is why it is one.

    Args:
        suspects: K objects, how well they are explained as static, and what tracks expect of them.
        moving: How well their motions explain them.
        seen: What the other sweeps could see of them.
        are_parts: (K,) whether they were cut out of long objects.
    """
    objects, standing, expected = suspects.objects, suspects.standing, suspects.expected
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    is_same = expected.is_known & are_same(moving.motions, expected.motions)
    columns = [
        np.ones(len(suspects)),
        _log_share(moving.cost, standing.cost, _NOISE_M),
        np.log1p(np.where(are_parts, 0.0, np.maximum(seen.free, 0.0)) * objects.counts),
        is_same,
        is_same * np.maximum(expected.scores, 0.0),
        np.log(objects.thicknesses + _THIN_M),
    ]
    if standing.past.shape[1]:
        gains = standing.past - moving.past
        columns += [
            gains.mean(axis=1) * np.maximum(1 - lengths / _SLOW_M, 0.0),
            (gains * seen.free_past).mean(axis=1),
            _log_share(moving.past.mean(axis=1), standing.past.mean(axis=1), _PAST_NOISE_M),
        ]
    else:
        columns.append(np.where(is_same, 0.0, np.log(np.maximum(lengths, 1.0))))
    return np.stack(columns, axis=1).astype(np.float64)


def _log_share(
    part: NDArray[np.float64], whole: NDArray[np.float64], noise_m: float
) -> NDArray[np.float64]:
    shares: NDArray[np.float64] = np.log((part + noise_m) / (whole + noise_m))
    return shares


# A shorter motion over ground is noise.
_MIN_MOTION_M: Final = 0.02
# A motion this much longer than the margin of free space leaves some behind it.
_CLEARLY: Final = 1.25
# Less than this share of its points in free space is none; nobody could see what is hidden mostly.
_MIN_FREE: Final = 0.1
_MAX_HIDDEN: Final = 0.5


def are_beams(
    objects: ObjectPoints, moving: JudgedMotions, seen: Visibility, next_: Target
) -> NDArray[np.bool_]:
    """Returns the mask (K,) of what goes along with the sensor and was never seen through.

    Along a wall, a kerb or a ceiling the traces of the beams go along with the sensor. Of a vehicle
    that does so the place was, or will be, seen to be empty, unless something else hid it.

    Args:
        objects: K objects.
        moving: Their motions.
        seen: What the other sweeps could see of them.
        next_: The next sweep.
    """
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    along = transformed(objects.centers, next_.to_current) - objects.centers
    goes_along = are_same(moving.motions, along)
    # A shorter way may not show.
    is_far = lengths > _CLEARLY * margin_m(np.sqrt((objects.centers**2).sum(axis=1)))
    beams: NDArray[np.bool_] = (
        goes_along & is_far & (seen.free < _MIN_FREE) & (seen.hidden < _MAX_HIDDEN)
    )
    return beams


def moves(
    suspects: Suspects,
    moving: JudgedMotions,
    beams: NDArray[np.bool_],
    scores: NDArray[np.float64],
    interval_s: float,
    settings: ObjectSettings,
) -> NDArray[np.bool_]:
    """Returns a mask (K,) of the objects called dynamic.

    Args:
        suspects: K objects, how well they are explained as static, and what tracks expect of them.
        moving: How well their motions explain them.
        beams: (K,) see `are_beams`.
        scores: (K,) logarithm of the odds that they move, see `moving_scores`.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    standing, expected = suspects.standing, suspects.expected
    lengths = np.hypot(moving.motions[:, 0], moving.motions[:, 1])
    # A track that was seen to move so is no trace of beams: far off, free space cannot tell.
    goes_on = (expected.evidence > 0) & are_same(moving.motions, expected.motions)
    is_possible = (lengths <= settings.max_speed_m_s * interval_s) & (~beams | goes_on)
    odds = settings.min_probability / (1 - settings.min_probability)
    is_clear = (scores > np.log(odds)) & (lengths > _MIN_MOTION_M)
    is_clear &= moving.total < settings.max_unexplained * standing.total
    # What was seen to move goes on, also slower, until standing explains as much.
    so_far = expected.evidence
    is_held = (so_far > 0) & (so_far + scores > 0) & (moving.total < standing.total)
    is_held &= lengths > _MIN_MOTION_M / 2
    is_held &= standing.past.max(axis=1, initial=0.0) > MIN_PAST_M
    are_dynamic: NDArray[np.bool_] = (is_held | is_clear) & is_possible
    return are_dynamic
