# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects move: all evidence in one number, and its limits."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import JudgedMotions, are_same
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.target import Targets
from mnsf_ros.settings import ObjectSettings

# Not fitted: of the odds so far this share carries over, as what speaks for a motion in one sweep
# does so in the next; and the number of places where something may match by chance grows with the
# square of the motion (simulated streets have fewer of them than real ones).
CARRIED: Final = 0.7
PER_LOG: Final = -2.0
# Logistic regressions, one number for each column of `evidence`: as `benchmarks/fit_weights.py`
# fits them, then balanced between found and false movers on random worlds with seeds below 330.
_WITH_PAST: Final = (-1.37, -0.5, 1.0, 0.9, -0.41, 1.4, CARRIED, 13.9)
_WITHOUT_PAST: Final = (-0.4, -0.9, 1.2, 1.03, -0.25, 2.0, CARRIED, PER_LOG)
# Below these, residuals are noise: of the neighbouring sweeps, and of the older ones.
_NOISE_M: Final = 0.01
_PAST_NOISE_M: Final = 0.02
# The longest motion that is slow, to the next sweep.
_SLOW_M: Final = 0.3
# By noise alone surfaces are thicker than this.
_THIN_M: Final = 0.03
# A shorter motion over ground is noise.
_MIN_MOTION_M: Final = 0.02
# Objects whose odds are lower than asked for by up to this (logarithm) are only followed.
_TENTATIVE: Final = 2.5


@dataclass(frozen=True, eq=False)
class Decision:
    """Each step leaves fewer objects: suspects, those searched, those fitted, those that move.

    Attributes:
        suspects: Objects that other sweeps do not support as static, and those with a track.
        searched: The K of them whose motion was searched: with a track, then the nearest ones.
        start: (K, 3) metres to the next sweep, where the fits of their motions started.
        fitted: The F of these that a motion may explain better.
        moving: The motions that were found.
        free: (F,) see `free_space`.
        evidence: (F, E) features for and against their motions.
        scores: (F,) logarithm of the odds that they move.
        is_moving: (F,) whether they are said to move.
        may_move: (F,) whether they are followed.
        seen: Those that are followed, together what moves together.
    """

    suspects: Suspects
    searched: Suspects
    start: NDArray[np.float32]
    fitted: Suspects
    moving: JudgedMotions
    free: NDArray[np.float64]
    evidence: NDArray[np.float64]
    scores: NDArray[np.float64]
    is_moving: NDArray[np.bool_]
    may_move: NDArray[np.bool_]
    seen: Sightings

    @property
    def num_left_out(self) -> int:
        """How many suspects were beyond the limits of the work."""
        return len(self.suspects) - len(self.searched)

    @property
    def doubtful(self) -> Suspects:
        """Suspects that are not called dynamic, with those beyond the limits of the work."""
        return self.suspects.only(~np.isin(self.suspects.rows, self.fitted.rows[self.is_moving]))


def moving_scores(features: NDArray[np.float64], *, has_past: bool) -> NDArray[np.float64]:
    """Returns (K,) logarithm of the odds that objects with some evidence (K, 8) move.

    Args:
        features: See `evidence`.
        has_past: Whether there are older sweeps.
    """
    weights = np.asarray(_WITH_PAST if has_past else _WITHOUT_PAST)
    return (features * weights).sum(axis=1)


def free_space(
    objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Returns (K,) how much rather objects are in free space of other sweeps if they stand.

    It is the share of an object's points that are there if it stands, less the same if it moves,
    summed over the sweeps. A place that was seen through is evidence of motion. One that was
    hidden, or beside the beams, is none: there a static object leaves a residual, too.

    Args:
        objects: K objects.
        targets: The other sweeps.
        motions: (K, 3) metres, to the next sweep.
    """
    free = np.zeros(len(objects))
    for target in (*targets.past, *targets.near):
        free += target.free_shares(objects, np.zeros_like(motions))
        free -= target.free_shares(objects, motions)
    return free


def evidence(
    suspects: Suspects,
    moving: JudgedMotions,
    free: NDArray[np.float64],
    are_parts: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Returns (K, 8) features for and against the motions of K objects.

    These are: 1; the logarithm of the share of the residual that the motion leaves in the
    neighbouring sweeps, plus that of the older ones; the logarithms of the number of points in
    free space and of the thickness; the height in metres; whether a track expected the motion; the
    odds of its track; what a slow motion explains better in older sweeps, in metres. Without these,
    the last is the logarithm of the metres from one on of a motion that no track expected.

    Free space says nothing of a part of a long object: that its place was free is why it is one.

    Args:
        suspects: K objects, how well they are explained as static, and what tracks expect of them.
        moving: How well their motions explain them.
        free: (K,) see `free_space`.
        are_parts: (K,) whether they were cut out of long objects.
    """
    objects, standing, expected = suspects.objects, suspects.standing, suspects.expected
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    is_same = expected.is_known & are_same(moving.motions, expected.motions)
    shares = _log_share(moving.cost, standing.cost, _NOISE_M)
    if suspects.has_past:
        past, standing_past = moving.past.mean(axis=1), standing.past.mean(axis=1)
        shares += _log_share(past, standing_past, _PAST_NOISE_M)
        gains = standing_past - past
        last = gains * np.maximum(1 - lengths / _SLOW_M, 0.0)
    else:
        last = np.where(is_same, 0.0, np.log(np.maximum(lengths, 1.0)))
    columns = (
        np.ones(len(suspects)),
        shares,
        np.log1p(np.where(are_parts, 0.0, np.maximum(free, 0.0)) * objects.counts),
        np.log(objects.thicknesses + _THIN_M),
        objects.heights,
        is_same,
        expected.scores,
        last,
    )
    return np.stack(columns, axis=1).astype(np.float64)


def _log_share(
    part: NDArray[np.float64], whole: NDArray[np.float64], noise_m: float
) -> NDArray[np.float64]:
    return np.log((part + noise_m) / (whole + noise_m))


def moves(
    suspects: Suspects,
    moving: JudgedMotions,
    scores: NDArray[np.float64],
    interval_s: float,
    settings: ObjectSettings,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns masks (K,) of the objects that may move and are followed, and of those that move.

    Args:
        suspects: K objects, how well they are explained as static, and what tracks expect of them.
        moving: How well their motions explain them.
        scores: (K,) logarithm of the odds that they move, see `moving_scores`.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    lengths = np.hypot(moving.motions[:, 0], moving.motions[:, 1])
    # What was seen to move goes on, also slower: what brakes was not where its motion of now says.
    has_moved = suspects.expected.scores > 0
    is_possible = moving.total < settings.max_unexplained * suspects.standing.total
    is_possible |= has_moved
    is_possible &= lengths > np.where(has_moved, _MIN_MOTION_M / 2, _MIN_MOTION_M)
    is_possible &= lengths <= settings.max_speed_m_s * interval_s
    limit = np.log(settings.min_probability / (1 - settings.min_probability))
    return is_possible & (scores > limit - _TENTATIVE), is_possible & (scores > limit)
