# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Motions of objects as predicted by their tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.tracks import Track, expecting_shares

# An object is that of a track if more than this share of its points is where that is expected.
_MIN_SHARE: Final = 0.3
_POINTS_PER_OBJECT: Final = 16


@dataclass(frozen=True, eq=False)
class Expectation:
    """Predictions for K objects from the sweeps before.

    Attributes:
        is_known: (K,) whether an object has a track.
        motions: (K, 3) float32, metres to the next sweep; 0 for objects without a track.
        scores: (K,) logarithm of the odds that their track moves; 0 without one.
        evidence: (K,) of their track, see `Track`; 0 without one.
    """

    is_known: NDArray[np.bool_]
    motions: NDArray[np.float32]
    scores: NDArray[np.float64]
    evidence: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        objects: ObjectPoints,
        tracks: Sequence[Track],
        world_from_sensor: NDArray[np.float64],
        interval_s: float,
    ) -> Expectation:
        """Returns the predictions of tracks, propagated to the current sweep, for its objects."""
        some = objects.thinner(_POINTS_PER_OBJECT)
        is_known = np.zeros(len(some), dtype=bool)
        motions = np.zeros((len(some), 3), np.float32)
        scores = np.zeros(len(some))
        evidence = np.zeros(len(some))
        if len(some) > 0 and len(tracks) > 0:
            world = transformed(some.positions, world_from_sensor).astype(np.float64)
            shares = expecting_shares(tracks, world, some.owners, len(some))
            rows = shares.argmax(axis=1)
            is_known = np.greater(shares.max(axis=1), _MIN_SHARE)
            velocities = np.stack([track.velocity for track in tracks])
            velocities = turned(velocities, world_from_sensor[:3, :3].T)
            motions[is_known] = velocities[rows[is_known]] * interval_s
            scores[is_known] = np.array([track.score for track in tracks])[rows[is_known]]
            evidence[is_known] = np.array([track.evidence for track in tracks])[rows[is_known]]
        return cls(is_known, motions, scores, evidence)

    def or_else(self, motions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns (K, 3) metres, the predictions, of objects without a track other motions."""
        return np.where(self.is_known[:, None], self.motions, motions)

    def only(self, wanted: NDArray[np.bool_]) -> Expectation:
        """Returns the predictions for the objects of the (K,) mask."""
        return Expectation(
            self.is_known[wanted],
            self.motions[wanted],
            self.scores[wanted],
            self.evidence[wanted],
        )
