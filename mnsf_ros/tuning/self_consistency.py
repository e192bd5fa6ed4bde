# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Cost of settings without labels: do points land on a surface of a later sweep?

Points are moved on by their motion over ground, at constant velocity for about 0.3 s, into a sweep
that the estimate has not seen. If the motion is right, a point of that sweep is near: a mover that
is called static is left behind, a static object that is called dynamic lands in free space. The few
points that a static world does not explain, by the settings to start from, weigh as much as all
others together. So neither "everything is static" nor "everything is dynamic" wins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, SweepTriplet
from mnsf_ros.tuning.judges import Half

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
class _Landing:
    """Chosen points of an example, and the later sweep on which they should land.

    Attributes:
        place: Number of the example in its stretch.
        later: Number of the later example.
        seconds: Time between them.
        triplet: The sweeps of the example.
        rows: (M,) the chosen points of its current sweep.
        tree: Points of the later sweep, its sensor frame.
    """

    place: int
    later: int
    seconds: float
    triplet: SweepTriplet
    rows: NDArray[np.int64]
    tree: cKDTree

    @property
    def xyz(self) -> NDArray[np.float64]:
        """(M, 3) the chosen points, metres, sensor frame."""
        return self.triplet.current.xyz[self.rows].astype(np.float64)

    @property
    def ranges_m(self) -> NDArray[np.float64]:
        """(M,) horizontal ranges of the chosen points."""
        ranges: NDArray[np.float64] = np.linalg.norm(self.xyz[:, :2], axis=1)
        return ranges

    def errors(
        self, known: Sequence[OverGround | None], *, are_static: bool
    ) -> NDArray[np.float64]:
        """(M,) landing errors, metres; `known` has one entry for each example of the stretch."""
        now, then = known[self.place], known[self.later]
        if now is None or then is None:
            return np.full(len(self.rows), _LIMIT_M)
        xyz = self.xyz
        if not are_static:
            interval_s = self.triplet.interval_s or USUAL_INTERVAL_S
            velocity = now.motion[self.rows].astype(np.float64) / interval_s
            xyz += velocity * self.seconds
        landed = apply(np.linalg.inv(then.world_from_sensor) @ now.world_from_sensor, xyz)
        distances, _ = self.tree.query(landed, distance_upper_bound=_LIMIT_M)
        limited: NDArray[np.float64] = np.minimum(distances, _LIMIT_M)
        return limited


class ConsistencyJudge:
    """Judges settings by landing errors about 0.3 s later."""

    goal: Final = "landing error 0.3 s later (m)"

    def __init__(self, half: Half, settings: Settings, seed: int = 0) -> None:
        """Chooses the points that a static world does not explain, with these settings."""
        self.half = half
        self._landings = [list(_landings(part, seed)) for part in half.stretches]
        static = self._errors(settings, are_static=True)
        ranges = [one.ranges_m for part in self._landings for one in part]
        limits = _NOISE_M + _SPACING * np.concatenate([*ranges, np.zeros(0)])
        self._is_open = static > limits

    def __call__(self, settings: Settings) -> float:
        """Returns the mean landing error of both kinds of points, metres, after all estimates."""
        errors = self._errors(settings)
        kinds = (errors[self._is_open], errors[~self._is_open])
        return sum(float(part.mean()) if len(part) else 0.0 for part in kinds) / len(kinds)

    def _errors(self, settings: Settings, *, are_static: bool = False) -> NDArray[np.float64]:
        parts: list[NDArray[np.float64]] = [np.zeros(0)]
        for estimates, landings in zip(self.half.estimated(settings), self._landings, strict=True):
            known = [flow.over_ground if flow else None for _, flow in estimates]
            parts.extend(landing.errors(known, are_static=are_static) for landing in landings)
        return np.concatenate(parts)


def _landings(stretch: Sequence[Example], seed: int) -> Iterator[_Landing]:
    for place, example in enumerate(stretch):
        later = _later(stretch, place)
        if later is None or not len(stretch[later].triplet.current.kept_xyz):
            continue
        rows = np.flatnonzero(example.scored)
        if len(rows) > _MAX_POINTS:
            random = np.random.default_rng([seed, example.triplet.current.stamp_ns])
            rows = random.choice(rows, _MAX_POINTS, replace=False)
        tree = cKDTree(stretch[later].triplet.current.kept_xyz)
        seconds = _seconds_between(example, stretch[later])
        yield _Landing(place, later, seconds, example.triplet, rows, tree)


def _later(stretch: Sequence[Example], place: int) -> int | None:
    """The example about 0.3 s later, if no sweep is missing in between."""
    first, apart_s = stretch[place], dict[int, float]()
    for later, other in enumerate(stretch[place + 1 :], place + 1):
        seconds = _seconds_between(first, other)
        has_gap = other.number - first.number != later - place
        if not has_gap and _LATER_S[0] <= seconds <= _LATER_S[1]:
            apart_s[later] = abs(seconds - _WANTED_S)
    return min(apart_s, key=lambda later: apart_s[later], default=None)


def _seconds_between(first: Example, later: Example) -> float:
    return (later.triplet.current.stamp_ns - first.triplet.current.stamp_ns) / NANOSECONDS
