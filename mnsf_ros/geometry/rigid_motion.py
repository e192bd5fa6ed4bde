# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid flow, and the rigid motion of most of a flow."""

from collections.abc import Callable
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.compiled import compiled

Floating = TypeVar("Floating", np.float32, np.float64)

# A motion has six unknowns: so many random points fix it far below their noise.
_MAX_POINTS: Final = 20_000
_MAX_ITERATIONS: Final = 60
# Median distance over standard deviation per axis, for Gaussian noise in three dimensions.
_MEDIAN_OF_NOISE: Final = 1.538
# Weights are 0 from so many standard deviations on; Gaussian noise stays below.
_TUKEY_REACH: Final = 6.0
# Smaller residuals are all alike: finer than the resolution of float32 at 100 m.
_MIN_SCALE_M: Final = 1e-5
# Points are on a line if their spread across it is this small beside that along it.
_MIN_SPREAD_RATIO: Final = 1e-3
# A point so many times farther out than half of them is an outlier that would turn all others.
_MAX_REACH_RATIO: Final = 50.0


def transformed(xyz: Floats32, transform: Floats) -> Floats32:
    """Returns (N, 3) points transformed by a (4, 4) matrix; the digits do not depend on threads."""
    turn, shift = (part.astype(np.float32) for part in (transform[:3, :3], transform[:3, 3]))
    return _turned_and_shifted(np.ascontiguousarray(xyz), np.ascontiguousarray(turn), shift)


def turned(vectors: NDArray[Floating], turn: Floats) -> NDArray[Floating]:
    """Returns vectors (N, 3) turned by a (3, 3) matrix, in their own precision."""
    own_turn = np.ascontiguousarray(turn, dtype=vectors.dtype)
    return _turned_and_shifted(np.ascontiguousarray(vectors), own_turn, np.zeros(3, vectors.dtype))


# A matrix product of BLAS may sum in another order with other threads.
@compiled(
    "float32[:, ::1](float32[:, ::1], float32[:, ::1], float32[::1])",
    "float64[:, ::1](float64[:, ::1], float64[:, ::1], float64[::1])",
)
def _turned_and_shifted(
    vectors: NDArray[Floating], turn: NDArray[Floating], shift: NDArray[Floating]
) -> NDArray[Floating]:
    result = np.empty_like(vectors)
    for row in range(len(vectors)):
        x, y, z = vectors[row, 0], vectors[row, 1], vectors[row, 2]
        for axis in range(3):
            turned = x * turn[axis, 0] + y * turn[axis, 1] + z * turn[axis, 2]
            result[row, axis] = turned + shift[axis]
    return result


def rigid_flow(xyz: NDArray[Any], next_from_current: Floats) -> Floats32:
    """Returns the flow (N, 3) of static points by the ego motion.

    It is float32, in metres per sweep interval, computed in float64. Rows that are not finite stay
    so.
    """
    # (R - I) p + t, not (R p + t) - p: far from the origin the difference would lose digits.
    turn = next_from_current[:3, :3] - np.eye(3)
    with np.errstate(over="ignore", invalid="ignore"):
        flow = turned(xyz.astype(np.float64), turn) + next_from_current[:3, 3]
        return flow.astype(np.float32)


def residual_flow(xyz: NDArray[Any], flow: NDArray[Any], next_from_current: Floats) -> Floats32:
    """Returns the flow (N, 3) without ego motion.

    It is float32, in metres per sweep interval, in the axes of the *next* sweep's sensor frame.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(flow - rigid_flow(xyz, next_from_current), dtype=np.float32)


def fit_rigid_motion(xyz: NDArray[Any], flow: NDArray[Any]) -> Floats:
    """Returns `next_from_current` (4, 4) of most points, for example the ego motion.

    Iteratively reweighted least squares (Kabsch): first with weights of the L1 norm, by which a
    clear majority wins from any start, then with Tukey's, which exclude movers. Some 30 % of the
    points may move, even all in the same way.

    Rows that are not finite and far outliers are left out. Where points do not fix a rotation
    (fewer than three, or all on one line) the result is a pure translation, without points the
    identity. It is never a reflection.
    """
    source, moved = _usable(xyz, flow)
    if len(source) == 0:
        return np.eye(4)
    # Around their middle, so that far from the origin rotation and translation stay apart.
    center = np.median(source, axis=0)
    source, moved = source - center, moved - center
    reach = np.linalg.norm(source, axis=1)
    near = reach <= max(_MAX_REACH_RATIO * float(np.median(reach)), _MIN_SCALE_M)
    source, moved = source[near], moved[near]
    motion = _kabsch(source, moved, np.ones(len(source)))
    motion = _refitted(source, moved, motion, _l1_weights, 1e-4)
    motion = _refitted(source, moved, motion, _tukey_weights, _MIN_SCALE_M / 100)
    motion[:3, 3] += center - motion[:3, :3] @ center
    return motion


def _refitted(
    source: Floats,
    moved: Floats,
    motion: Floats,
    weights_of: Callable[[Floats], Floats],
    tolerance: float,
) -> Floats:
    """Returns the motion refitted with weights of its residuals until it converges."""
    for _ in range(_MAX_ITERATIONS):
        off = source @ motion[:3, :3].T + motion[:3, 3] - moved
        residuals = np.sqrt(np.einsum("ij,ij->i", off, off))
        last, motion = motion, _kabsch(source, moved, weights_of(residuals))
        if np.abs(motion - last).max() < tolerance:
            break
    return motion


def _l1_weights(residuals: Floats) -> Floats:
    return 1.0 / np.maximum(residuals, max(float(np.median(residuals)) * 1e-2, _MIN_SCALE_M))


def _tukey_weights(residuals: Floats) -> Floats:
    scale = max(float(np.median(residuals)) / _MEDIAN_OF_NOISE, _MIN_SCALE_M)
    return np.maximum(0.0, 1.0 - (residuals / (_TUKEY_REACH * scale)) ** 2) ** 2


def _kabsch(source: Floats, moved: Floats, weights: Floats) -> Floats:
    """Returns the (4, 4) rigid motion of least weighted squares from source to moved (N, 3)."""
    pairs = np.hstack([source, moved])
    weighted = pairs * (weights / weights.sum())[:, None]
    centers = weighted.sum(axis=0)
    # Not around the centers first: the sweeps are around their middle, which is exact enough.
    products = weighted.T @ pairs - np.outer(centers, centers)
    motion = np.eye(4)
    spread = np.linalg.svd(products[:3, :3], compute_uv=False)
    if spread[1] > spread[0] * _MIN_SPREAD_RATIO**2:
        left, _, right = np.linalg.svd(products[3:, :3])
        left[:, 2] *= np.sign(np.linalg.det(left @ right))
        motion[:3, :3] = left @ right
    source_center, moved_center = np.split(centers, 2)
    motion[:3, 3] = moved_center - motion[:3, :3] @ source_center
    return motion


def _usable(xyz: NDArray[Any], flow: NDArray[Any]) -> tuple[Floats, Floats]:
    """Returns finite points before and after their flow, (M, 3) each, M at most `_MAX_POINTS`."""
    with np.errstate(over="ignore"):  # as float32: the square of any such number is a float64
        finite = np.isfinite(np.hstack([xyz, flow]).astype(np.float32)).all(axis=1)
    rows = np.flatnonzero(finite)
    if len(rows) > _MAX_POINTS:
        # At random, because every n-th point of a sweep may be a single laser's.
        rows = np.random.default_rng(0).choice(rows, _MAX_POINTS, replace=False)
    source = xyz[rows].astype(np.float64)
    return source, source + flow[rows]
