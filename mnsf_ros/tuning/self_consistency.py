# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Cost of settings without labels: do points land on a surface of a later sweep?

Points are moved on by their motion over ground, at constant velocity for about 0.3 s, into a sweep
that the estimate has not seen. If the motion is right, a point of that sweep is near: a mover that
is called static is left behind, a static object that is called dynamic lands in free space. The few
points that a static world does not explain, by the settings to start from, weigh as much as all
others together. So neither "everything is static" nor "everything is dynamic" wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.evaluation.examples import Example
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S
from mnsf_ros.tuning.halves import Estimate, Half
from mnsf_ros.tuning.judges import Judgement

_LATER_S: Final = (0.2, 0.45)
_WANTED_S: Final = 0.3
_MAX_POINTS: Final = 4000
# Upper limit of landing errors.
_LIMIT_M: Final = 0.5
# Distance of a static point to the nearest point of a later sweep: noise, plus a share of the range
# for the spacing of the beams.
_NOISE_M: Final = 0.1
_SPACING: Final = 0.01


@dataclass(frozen=True, eq=False)
class _Followed:
    """The chosen points of an estimate.

    Attributes:
        velocity: (M, 3) m/s over ground, axes of the sensor.
        world_from_sensor: (4, 4) pose of the sweep.
    """

    velocity: NDArray[np.float64]
    world_from_sensor: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Pair:
    """An example, and a later one of the same recording.

    Attributes:
        place: Number of the example in its stretch.
        later: Number of the later one.
        seconds: Time between them.
        xyz: (M, 3) metres, points of the first one, sensor frame.
        tree: The points of the later one, its sensor frame.
    """

    place: int
    later: int
    seconds: float
    xyz: NDArray[np.float64]
    tree: cKDTree

    def distances(
        self, followed: Sequence[_Followed | None], *, are_static: bool = False
    ) -> NDArray[np.float64]:
        """(M,) landing errors: metres from a moved point to the nearest later point."""
        now, then = followed[self.place], followed[self.later]
        if now is None or then is None:
            return np.full(len(self.xyz), _LIMIT_M)
        moved = self.xyz if are_static else self.xyz + now.velocity * self.seconds
        then_from_now = np.linalg.inv(then.world_from_sensor) @ now.world_from_sensor
        landed = moved @ then_from_now[:3, :3].T + then_from_now[:3, 3]
        distances, _ = self.tree.query(landed, distance_upper_bound=_LIMIT_M)
        limited: NDArray[np.float64] = np.minimum(distances, _LIMIT_M)
        return limited


class ConsistencyJudge:
    """Judges settings by landing errors about 0.3 s later."""

    goal: Final = "landing error 0.3 s later (m)"

    def __init__(self, half: Half, settings: Settings, seed: int = 0) -> None:
        """Chooses the points that a static world does not explain, with these settings."""
        self.half = half
        self._rows = [[_chosen(one, seed) for one in part] for part in half.stretches]
        self._pairs = [
            _pairs(part, rows) for part, rows in zip(half.stretches, self._rows, strict=True)
        ]
        static = self._distances(settings, are_static=True)
        ranges = [np.linalg.norm(one.xyz[:, :2], axis=1) for part in self._pairs for one in part]
        limits = _NOISE_M + _SPACING * np.concatenate([*ranges, np.zeros(0)])
        self._is_open = static > limits

    def __call__(self, settings: Settings) -> Judgement:
        """Estimates all examples and measures their landing errors."""
        distances = self._distances(settings)
        parts = [
            float(distances[mask].mean()) if mask.any() else 0.0
            for mask in (self._is_open, ~self._is_open)
        ]
        names = ("points that a static world does not explain (m)", "all other points (m)")
        cost = sum(parts) / len(parts)
        return Judgement(cost, {self.goal: cost, **dict(zip(names, parts, strict=True))})

    def _distances(self, settings: Settings, *, are_static: bool = False) -> NDArray[np.float64]:
        parts: list[NDArray[np.float64]] = [np.zeros(0)]
        estimated = self.half.estimated(settings)
        for estimates, rows, pairs in zip(estimated, self._rows, self._pairs, strict=True):
            followed = list(map(_followed, estimates, rows))
            parts.extend(pair.distances(followed, are_static=are_static) for pair in pairs)
        return np.concatenate(parts)


def _chosen(example: Example, seed: int) -> NDArray[np.int64]:
    rows = np.flatnonzero(example.scored)
    random = np.random.default_rng([seed, example.triplet.current.stamp_ns])
    return rows if len(rows) <= _MAX_POINTS else random.choice(rows, _MAX_POINTS, replace=False)


def _pairs(stretch: Sequence[Example], rows: Sequence[NDArray[np.int64]]) -> list[_Pair]:
    pairs = []
    for place, example in enumerate(stretch):
        current = example.triplet.current
        later = _later(stretch, place)
        if later is not None and len(stretch[later].triplet.current.kept_xyz):
            then = stretch[later].triplet.current
            seconds = (then.stamp_ns - current.stamp_ns) / NANOSECONDS
            xyz = current.xyz[rows[place]].astype(np.float64)
            pairs.append(_Pair(place, later, seconds, xyz, cKDTree(then.kept_xyz)))
    return pairs


def _later(stretch: Sequence[Example], place: int) -> int | None:
    """The example about 0.3 s later, if no sweep is missing in between."""
    first, apart_s = stretch[place], dict[int, float]()
    for later in range(place + 1, len(stretch)):
        other = stretch[later]
        passed_ns = other.triplet.current.stamp_ns - first.triplet.current.stamp_ns
        has_gap = other.number - first.number != later - place
        if not has_gap and _LATER_S[0] <= passed_ns / NANOSECONDS <= _LATER_S[1]:
            apart_s[later] = abs(passed_ns / NANOSECONDS - _WANTED_S)
    return min(apart_s, key=lambda later: apart_s[later], default=None)


def _followed(estimate: Estimate, rows: NDArray[np.int64]) -> _Followed | None:
    example, result = estimate
    if result is None or result.over_ground is None:
        return None
    known = result.over_ground
    interval_s = example.triplet.interval_s or USUAL_INTERVAL_S
    velocity = known.motion[rows].astype(np.float64) / interval_s
    return _Followed(velocity, known.world_from_sensor)
