"""How likely an object moves: all evidence in one number."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.suspects import Suspects

# Logistic regressions; `python benchmarks/evidence.py` prints the numbers. For each column of
# `evidence`: constant, logarithm of the share of the residual in the neighbouring sweeps that the
# motion leaves, free space up to 0.5, all free space, logarithm of the number of points, metres to
# the next sweep, agreement with a track, and with what score of that, gain in the past per metre.
_WITH_PAST: Final = (-3.69, -0.99, 4.03, 0.67, 0.0, -1.27, 1.13, 0.36, 7.98)
_WITHOUT_PAST: Final = (-7.3, -1.72, 7.88, 0.0, 1.5, -2.38, 1.13, 0.36)
# What the sweeps before say of an object does not count for more than this.
_MAX_SCORE: Final = 6.0
# Below this, residuals are noise.
_NOISE_M: Final = 0.01
_MUCH_FREE: Final = 0.5
_LONG_M: Final = 1.0
# A motion is that of the track if it differs by less than this plus this share.
_SAME_MOTION_M: Final = 0.05
_SAME_MOTION_SHARE: Final = 0.2


def moving_scores(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns (K,) logarithm of the odds that objects with some evidence (K, F) move."""
    weights = _WITH_PAST if features.shape[1] == len(_WITH_PAST) else _WITHOUT_PAST
    scores: NDArray[np.float64] = (features * np.asarray(weights)).sum(axis=1)
    return np.clip(scores, -_MAX_SCORE, _MAX_SCORE)


def evidence(
    suspects: Suspects, moving: JudgedMotions, free: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns (K, F) what speaks for the motions of K objects.

    Args:
        suspects: K objects, how well they are explained as static, and what tracks expect of them.
        moving: How well their motions explain them.
        free: (K,) evidence of motion from free space, see `seen_through`.
    """
    standing, expected = suspects.standing, suspects.expected
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    apart = np.sqrt(((moving.motions - expected.motions) ** 2).sum(axis=1))
    is_same = expected.is_known & (apart < _SAME_MOTION_M + _SAME_MOTION_SHARE * lengths)
    columns = [
        np.ones(len(suspects)),
        np.log((moving.cost + _NOISE_M) / (standing.cost + _NOISE_M)),
        np.minimum(free, _MUCH_FREE),
        free,
        np.log(suspects.objects.counts),
        np.minimum(lengths, _LONG_M),
        is_same,
        is_same * np.maximum(expected.scores, 0.0),
    ]
    if standing.past.shape[1]:
        columns.append((standing.past - moving.past).mean(axis=1))
    return np.stack(columns, axis=1).astype(np.float64)
