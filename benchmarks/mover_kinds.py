# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Kinds of movers that are hard for one translation per object, or hard to tell from others."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.evaluation.movers import TrueMotion
from mnsf_ros.recording.flow_truth import SurfaceClass

# Turning: true turn rate; only of objects whose points are so far apart (root mean square).
_MIN_TURN_RATE_RAD_S: Final = 0.15
_MIN_RADIUS_M: Final = 0.5
# Bending: root mean square deviation from the best rigid motion until the next sweep.
_MIN_BENDING_M: Final = 0.03
# Touching: distance to anything else above the ground. Crowds: distance between pedestrians.
_TOUCHING_M: Final = 0.3
_CROWD_M: Final = 1.0
_MIN_POINTS: Final = 20
_MAX_RANGE_M: Final = 50.0
_GROUND: Final = (SurfaceClass.ROAD, SurfaceClass.SIDEWALK)

KINDS: Final = ("plain", "turning", "bending", "touching", "crowds")


def mover_kinds(truth: TrueMotion) -> Iterator[tuple[NDArray[np.int64], set[str]]]:
    """Yields the points of each mover of a sweep, and its kinds; `plain` if it has no other.

    A mover has at least 20 dynamic points within 50 m.
    """
    near = truth.dynamic & (np.hypot(*truth.xyz[:, :2].T) <= _MAX_RANGE_M)
    ids, counts = np.unique(truth.object_id[near], return_counts=True)
    above_ground = ~np.isin(truth.class_id, _GROUND)
    for number in ids[(ids > 0) & (counts >= _MIN_POINTS)]:
        is_own = truth.object_id == number
        own, others = np.flatnonzero(near & is_own), above_ground & ~is_own
        is_pedestrian = truth.class_id == SurfaceClass.PEDESTRIAN
        turn_rate_rad_s, bending_m = _shape_of_motion(truth, own)
        holds = {
            "turning": turn_rate_rad_s > _MIN_TURN_RATE_RAD_S,
            "bending": bending_m > _MIN_BENDING_M,
            "touching": _are_close(truth.xyz[own], truth.xyz[others], _TOUCHING_M),
            "crowds": is_pedestrian[own[0]]
            and _are_close(truth.xyz[own], truth.xyz[others & is_pedestrian], _CROWD_M),
        }
        yield own, {kind for kind in KINDS if holds.get(kind)} or {"plain"}


def _shape_of_motion(truth: TrueMotion, own: NDArray[np.int64]) -> tuple[float, float]:
    """Turn rate (rad/s) of the best rigid motion along the ground, and deviation from it (m)."""
    xyz = truth.xyz[own].astype(np.float64)
    before, after = (
        points - points.mean(axis=0)
        for points in (xyz, xyz + truth.velocity[own] * truth.interval_s)
    )
    # Points of the plane as complex numbers: a turn is a product.
    start, end = (points[:, 0] + 1j * points[:, 1] for points in (before, after))
    angle_rad = np.angle(np.vdot(start, end))
    off = np.abs(start * np.exp(1j * angle_rad) - end) ** 2 + (after - before)[:, 2] ** 2
    is_wide = np.mean(np.abs(start) ** 2) >= _MIN_RADIUS_M**2
    return abs(angle_rad) / truth.interval_s if is_wide else 0.0, float(np.sqrt(off.mean()))


def _are_close(points: NDArray[np.float32], others: NDArray[np.float32], limit_m: float) -> bool:
    """Whether any of the points (N, 3) is within a distance of any of others (M, 3)."""
    low, high = points.min(axis=0) - limit_m, points.max(axis=0) + limit_m
    around = others[((others >= low) & (others <= high)).all(axis=1)]
    if len(around) == 0:
        return False
    distances_m, _ = cKDTree(around).query(points, distance_upper_bound=limit_m)
    return bool(distances_m.min() <= limit_m)
