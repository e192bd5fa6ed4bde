# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What tracks expect of the objects of a sweep: the prior of their motions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.online.object_points import ObjectPoints, Rows
from mnsf_ros.online.tracks import MIN_SHARE, Track, expecting_shares


@dataclass(frozen=True, eq=False)
class Expectation(Rows):
    """Predictions for K objects from the sweeps before.

    Attributes:
        shares: (K,) share of an object's points that lie where its track predicts them; 0 without a
            track.
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

    def prior_cost(self, motions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Returns (K,) the prior costs of motions (K, 3), metres: their negative log-likelihood.

        A moving track predicts its object's motion within the errors of the track. If the track
        does not move, or predicts no more than half of the object's points, all motions are equally
        likely and the cost is 0, as it is without a track.
        """
        moves = expit(self.scores) * (self.shares > 0.5)
        apart = ((motions - self.motions)[:, :2] ** 2).sum(axis=1) / self.deviations_m**2
        return np.asarray(-np.log(moves * np.exp(-apart / 2) + 1 - moves), np.float64)

    def or_else(self, motions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns (K, 3) metres, the predictions; without a track, the given motions."""
        return np.where(self.is_known[:, None], self.motions, motions)

    def candidates(self, motions: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Returns (K, 3) metres each: the given motions, and the predictions if there are any."""
        return [motions, self.or_else(motions)] if self.is_known.any() else [motions]
