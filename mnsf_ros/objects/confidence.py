"""The probability that a flow is less than 0.1 m off, fitted to recordings with ground truth."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.object_points import ObjectPoints

# Logistic regressions; `python benchmarks/confidence.py` prints the numbers and how well they hold.
# Dynamic objects: constant, per metre of disagreement, per metre of residual, per unit of the score
# that they move, per logarithm of the thickness, per metre to the next sweep up to 2 m. Each object
# counts by its points to the power of 0.75, so that a few large ones do not decide.
_MOVING: Final = (3.50, -0.82, -15.1, 0.52, 1.27, -1.29)
# Suspects without an accepted motion: constant, per metre of residual, per 10 m of range.
_DOUBTFUL: Final = (2.79, -9.37, 0.20)
# Points that were never suspects: constant, per 10 m of range.
_STANDING: Final = (5.73, -0.18)
# By noise alone surfaces are thicker than this.
_THIN_M: Final = 0.05
_LONG_M: Final = 2.0
# Beyond this the confidence is 0 or 1, and the exponential would overflow.
_MAX_SCORE: Final = np.float32(80)


def moving_confidence(
    objects: ObjectPoints, moving: JudgedMotions, scores: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Returns (K,) the confidence in the flow of K dynamic objects.

    Args:
        objects: K objects.
        moving: Their motions.
        scores: (K,) logarithm of the odds that they move, see `moving_scores`.
    """
    return _logistic(moving_features(objects, moving, scores), _MOVING)


def doubtful_confidence(objects: ObjectPoints, standing: JudgedMotions) -> NDArray[np.float32]:
    """Returns (K,) the confidence in the flow of K suspects without an accepted motion."""
    return _logistic(doubtful_features(objects, standing), _DOUBTFUL)


def standing_confidence(xyz: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (N,) the confidence in the flow of static points (N, 3), metres."""
    return _probability(_standing_scores(np.ascontiguousarray(xyz)))


@compiled("float32[::1](float32[:, ::1])")
def _standing_scores(xyz: NDArray[np.float32]) -> NDArray[np.float32]:
    constant, per_metre = np.float32(_STANDING[0]), np.float32(_STANDING[1] / 10)
    scores = np.empty(len(xyz), np.float32)
    # Of a flat array the compiler knows the steps: it looks at several points at once.
    values = xyz.reshape(-1)
    for point in range(len(xyz)):
        x, y = np.float64(values[3 * point]), np.float64(values[3 * point + 1])
        scores[point] = constant + per_metre * np.float32(math.sqrt(x * x + y * y))
    return scores


def moving_features(
    objects: ObjectPoints, moving: JudgedMotions, scores: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns (K, 6) the features of K dynamic objects."""
    lengths = np.minimum(np.sqrt((moving.motions**2).sum(axis=1)), _LONG_M)
    thicknesses = np.log(objects.thicknesses + _THIN_M)
    return _with_constant(moving.disagreement, moving.cost, scores, thicknesses, lengths)


def doubtful_features(objects: ObjectPoints, standing: JudgedMotions) -> NDArray[np.float64]:
    """Returns (K, 3) the features of K suspects without an accepted motion."""
    return _with_constant(standing.cost, _tens_of_metres(objects.centers))


def standing_features(xyz: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns (N, 2) the features of static points (N, 3), metres."""
    return _with_constant(_tens_of_metres(xyz))


def _with_constant(*columns: NDArray[Any]) -> NDArray[np.float64]:
    return np.stack([np.ones(len(columns[0])), *columns], axis=1).astype(np.float64)


def _tens_of_metres(xyz: NDArray[np.float32]) -> NDArray[np.float32]:
    ranges: NDArray[np.float32] = np.hypot(xyz[:, 0], xyz[:, 1]).astype(np.float32, copy=False)
    ranges /= 10
    return ranges


def _logistic(features: NDArray[np.float64], weights: tuple[float, ...]) -> NDArray[np.float32]:
    return _probability((features * np.asarray(weights)).sum(axis=1).astype(np.float32))


def _probability(score: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (N,) the logistic function of scores (N,)."""
    bounded = np.clip(score, -_MAX_SCORE, _MAX_SCORE)
    probability: NDArray[np.float32] = (1 / (1 + np.exp(-bounded))).astype(np.float32, copy=False)
    return probability
