# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The probability that a flow is less than 0.1 m off, fitted to recordings with ground truth."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.compiled import compiled
from mnsf_ros.online.motions import JudgedMotions
from mnsf_ros.online.object_points import NOISE_M

# Logistic regressions; `python benchmarks/fit_weights.py` prints the numbers.
# The weight of an object is its number of points to the power of 0.75, so that large ones do not
# dominate. Dynamic objects: constant, log(residual / its rise for shifted motions), log(1 +
# log-odds that they move), log(1 + length of the motion in metres).
_MOVING: Final = (0.39, -0.79, 1.19, -2.56)
# Suspects without an accepted motion: constant, per metre of residual.
_DOUBTFUL: Final = (1.91, -6.51)
# Points that were never suspects: constant, per 10 m of range.
_STATIC: Final = (3.12, -0.34)


def moving_confidence(moving: JudgedMotions, log_odds: Floats, residual_rise: Floats) -> Floats32:
    """Returns (K,) the confidence in the flow of K dynamic objects.

    Args:
        moving: Their motions.
        log_odds: (K,) that they move, see `moving_log_odds`.
        residual_rise: (K,) metres, rise of the residual for shifted motions, see `residual_rise_m`.
    """
    return _logistic(moving_features(moving, log_odds, residual_rise), _MOVING)


def doubtful_confidence(static: JudgedMotions) -> Floats32:
    """Returns (K,) the confidence in the flow of K suspects without an accepted motion.

    Args:
        static: Their residuals as static objects.
    """
    return _logistic(doubtful_features(static), _DOUBTFUL)


@compiled("float32[::1](float32[:, ::1])")
def static_confidence(xyz: Floats32) -> Floats32:
    """Returns (N,) the confidence in the flow of static points (N, 3), metres."""
    constant, per_metre = np.float32(_STATIC[0]), np.float32(_STATIC[1] / 10)
    confidence = np.empty(len(xyz), np.float32)
    # Of a flat array the compiler knows the steps: it looks at several points at once.
    values = xyz.reshape(-1)
    for point in range(len(xyz)):
        x, y = values[3 * point], values[3 * point + 1]
        log_odds = constant + per_metre * np.sqrt(x * x + y * y)
        confidence[point] = np.float32(1.0) / (np.float32(1.0) + np.exp(-log_odds))
    return confidence


def moving_features(moving: JudgedMotions, log_odds: Floats, residual_rise: Floats) -> Floats:
    """Returns (K, 4) the features of K dynamic objects, see `moving_confidence`."""
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    uncertainty = np.log((moving.near_mean + NOISE_M) / (residual_rise + NOISE_M))
    return _with_constant(uncertainty, np.log1p(np.maximum(log_odds, 0.0)), np.log1p(lengths))


def doubtful_features(static: JudgedMotions) -> Floats:
    """Returns (K, 2) the features of K suspects, see `doubtful_confidence`."""
    return _with_constant(static.near_mean)


def static_features(xyz: Floats32) -> Floats:
    """Returns (N, 2) the features of static points (N, 3), metres."""
    return _with_constant(np.hypot(xyz[:, 0], xyz[:, 1]) / 10)


def _with_constant(*columns: NDArray[Any]) -> Floats:
    return np.stack([np.ones(len(columns[0])), *columns], axis=1).astype(np.float64)


def _logistic(features: Floats, weights: tuple[float, ...]) -> Floats32:
    return np.asarray(expit((features * np.asarray(weights)).sum(axis=1)), np.float32)
