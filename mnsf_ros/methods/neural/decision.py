# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether parts with a fitted flow move: the log-odds of all evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.methods.neural.parts import Parts
from mnsf_ros.objects.target import Target

# Log-odds of a part with the constant; per unit of the logarithm of the share of its residual that
# the flow leaves, of the free space, of an expectation, and of the logarithm of its width. Fitted
# to the suspected parts of 15 random worlds (even seeds from 100 to 128); less 1 for the constant.
_CONSTANT: Final = -1.65
_PER_LEFT: Final = -1.02
_PER_FREE: Final = 0.92
_EXPECTED: Final = 2.04
_PER_WIDTH: Final = 0.74
# Shares below this, and widths, are all alike.
_MIN_LEFT: Final = 0.03
_MIN_WIDTH_M: Final = 0.02
_FREE_LIMITS: Final = (-1.0, 3.0)
# Nothing that moves leaves more residual in the neighbouring sweeps, or moves by less.
_MAX_NEAR_M: Final = 0.2
_MIN_MOTION_M: Final = 0.02


def log_odds(
    parts: Parts,
    near: Sequence[Target],
    past: Sequence[Target],
    flow: NDArray[np.float32],
    is_expected: NDArray[np.bool_],
    max_motion_m: float,
) -> NDArray[np.float64]:
    """Returns (K,) the logarithm of the odds that parts move by their flow.

    Args:
        parts: K parts.
        near: The neighbouring sweeps.
        past: Older sweeps.
        flow: (P, 3) metres to the next sweep, of their points.
        is_expected: (K,) the parts that moved in the sweep before.
        max_motion_m: Longest possible motion.
    """
    no_flow = np.zeros_like(flow)
    moving = np.stack([parts.means(parts.point_residuals(t, flow)) for t in (*near, *past)])
    static = np.stack([parts.means(parts.point_residuals(t, no_flow)) for t in (*near, *past)])
    left = moving.mean(axis=0) / np.maximum(static.mean(axis=0), 1e-6)
    free = sum(_freed(parts, target, flow) for target in (*near, *past))
    widths = parts.extents[:, :2].min(axis=1)
    odds = (
        _CONSTANT
        + _PER_LEFT * np.log(left + _MIN_LEFT)
        + _PER_FREE * np.clip(free, *_FREE_LIMITS)
        + _EXPECTED * is_expected
        + _PER_WIDTH * np.log(np.maximum(widths, _MIN_WIDTH_M))
    )
    lengths = np.linalg.norm(parts.means(flow), axis=1)
    is_possible = (moving[: len(near)].mean(axis=0) < _MAX_NEAR_M) & (lengths > _MIN_MOTION_M)
    return np.where(is_possible & (lengths < max_motion_m), odds, -np.inf)


def _freed(parts: Parts, target: Target, flow: NDArray[np.float32]) -> NDArray[np.float64]:
    """(K,) share of points that are in free space of a target without their flow, less with it."""
    shares = []
    for moved in (parts.positions, parts.positions + np.float32(target.steps) * flow):
        places = transformed(moved, target.from_current)
        is_free, _ = target.sweep.view.free_and_hidden(places)
        shares.append(parts.means(is_free))
    return shares[0] - shares[1]
