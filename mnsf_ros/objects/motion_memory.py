# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Memory from one estimate to the next: the tracks of movers, and what they expect."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.tracks import MIN_SHARE, Track, alive, expecting_shares, follow
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start, Stretch


@dataclass(frozen=True, eq=False)
class Expectation:
    """Predictions for K objects from the sweeps before.

    Attributes:
        shares: (K,) which share of an object's points its track expects; 0 without a track.
        motions: (K, 3) float32, metres to the next sweep; 0 for objects without a track.
        turn_rates: (K,) radians per second; 0 without a track.
        scores: (K,) logarithm of the odds that their track moves; 0 without one.
        deviations_m: (K,) standard deviation of the motions along each axis; 1 without a track.
    """

    shares: NDArray[np.float64]
    motions: NDArray[np.float32]
    turn_rates: NDArray[np.float64]
    scores: NDArray[np.float64]
    deviations_m: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        objects: ObjectPoints,
        tracks: Sequence[Track],
        world_from_sensor: NDArray[np.float64],
        interval_s: float,
    ) -> "Expectation":
        """Returns the predictions of tracks, propagated to the current sweep, for its objects."""
        some = objects.thinner()
        motions = np.zeros((len(some), 3), np.float32)
        best, turn_rates, scores = np.zeros((3, len(some)))
        deviations_m = np.ones(len(some))
        if len(some) > 0 and len(tracks) > 0:
            world = transformed(some.positions, world_from_sensor).astype(np.float64)
            shares = expecting_shares(tracks, world, some.owners, len(some))
            rows = shares.argmax(axis=1)
            is_known = shares.max(axis=1) > MIN_SHARE
            rows = rows[is_known]
            best[is_known] = shares[is_known, rows]
            velocities = np.stack([track.velocity for track in tracks])
            velocities = turned(velocities, world_from_sensor[:3, :3].T)
            motions[is_known] = velocities[rows] * interval_s
            variances = np.array([track.covariance[1, 1] for track in tracks])
            deviations_m[is_known] = np.sqrt(variances[rows]) * interval_s
            told = np.array([(track.turn_rate, track.score) for track in tracks])
            turn_rates[is_known], scores[is_known] = told[rows].T
        return cls(best, motions, turn_rates, scores, deviations_m)

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """(K,) whether an object has a track."""
        return self.shares > 0

    def surprise(self, motions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Returns (K,) how much less likely motions (K, 3), metres, are than those expected.

        It is a logarithm, and 0 without a track. What moves goes on as its track does, within the
        errors of that. Of what does not, or is mostly another thing than its track was, no motion
        is more likely than another one.
        """
        moves = expit(self.scores) * (self.shares > 0.5)
        apart = ((motions - self.motions)[:, :2] ** 2).sum(axis=1) / self.deviations_m**2
        return np.asarray(-np.log(moves * np.exp(-apart / 2) + 1 - moves), np.float64)

    def or_else(self, motions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns (K, 3) metres, the predictions, of objects without a track other motions."""
        return np.where(self.is_known[:, None], self.motions, motions)

    def beside(self, motions: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Returns (K, 3) metres each, other motions, and the predictions if there are any."""
        return [motions, self.or_else(motions)] if self.is_known.any() else [motions]

    def only(self, wanted: NDArray[np.bool_]) -> "Expectation":
        """Returns the predictions for the objects of the (K,) mask."""
        return Expectation(*(getattr(self, each.name)[wanted] for each in fields(self)))


class MotionMemory:
    """Remembers movers as long as the stretch of the stream goes on."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._stretch: Stretch | None = None
        self._tracks: list[Track] | None = None
        self._next_id = 1

    def with_settings(self, settings: Settings, *, is_same_world: bool) -> "MotionMemory":
        """Returns a memory for other settings.

        It knows what this one does if objects and the world that they are in stay the same.
        """
        other = MotionMemory(settings)
        other._next_id = self._next_id
        if is_same_world:
            other._stretch, other._tracks = self._stretch, self._tracks
        return other

    def enter(self, stretch: Stretch) -> Start:
        """Forgets the tracks of another stretch. Returns where the estimate starts."""
        if stretch is not self._stretch:
            self._stretch, self._tracks = stretch, None
        if not self._settings.warm_start.enabled:
            return Start.COLD_BY_SETTING
        return stretch.start if self._tracks is None else Start.WARM

    def follow(
        self, expected: Sequence[Track], seen: Sightings, stamp_ns: int, interval_s: float
    ) -> tuple[list[Track], NDArray[np.int64]]:
        """Associates what may move in the current sweep with the tracks, and updates these.

        Args:
            expected: The tracks, see `expected`.
            seen: What moves, or may move, in the sweep.
            stamp_ns: Time of the sweep.
            interval_s: Time to the next sweep.

        Returns:
            The tracks, and (K,) the number of the track of each of the objects that were seen.
        """
        tracks, ids = follow(expected, seen, stamp_ns, self._next_id)
        self._next_id = max(self._next_id, int(ids.max(initial=0)) + 1)
        if self._settings.warm_start.enabled and interval_s > 0:
            self._tracks = tracks
        return tracks, ids[seen.groups]

    def expected(self, stamp_ns: int, interval_s: float) -> list[Track]:
        """Returns the tracks as they are expected in a sweep, so long before the next one."""
        if self._tracks is None or interval_s <= 0:
            return []
        return alive(self._tracks, stamp_ns)
