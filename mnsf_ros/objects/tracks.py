# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracks: identity, position, velocity and covariance of movers from sweep to sweep."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.sweeps.sweep import NANOSECONDS

# Standard deviation of the acceleration of people and cars.
_ACCELERATION_M_S2: Final = 3.0


@dataclass(frozen=True, eq=False)
class Tracks:
    """K movers at one time, in the world.

    Attributes:
        stamp_ns: When.
        frame_id: The frame of the sensor that saw them.
        ids: (K,) int, numbers from 1, rising.
        states: (K, 2, 3) place in metres and velocity in metres per second.
        covariances: (K, 2, 2) of place and velocity, the same along each axis.
        begun_ns: (K,) int, when each was first seen to move.
        seen_ns: (K,) int, when each was last seen to move.
        num_seen: (K,) int, in how many sweeps.
        scores: (K,) logarithm of the odds that they move, by the last sweep that showed them.
        points: (P, 3) metres, where they were last seen, moved to where they should be by now.
        owners: (P,) int from 0 to K - 1, rising.
    """

    stamp_ns: int
    frame_id: str
    ids: NDArray[np.int64]
    states: NDArray[np.float64]
    covariances: NDArray[np.float64]
    begun_ns: NDArray[np.int64]
    seen_ns: NDArray[np.int64]
    num_seen: NDArray[np.int64]
    scores: NDArray[np.float64]
    points: NDArray[np.float64]
    owners: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """(K, 3) metres per second."""
        return self.states[:, 1]

    def only(self, wanted: NDArray[np.bool_]) -> Tracks:
        """Returns the tracks of the (K,) mask."""
        is_chosen = wanted[self.owners]
        return replace(
            self,
            ids=self.ids[wanted],
            states=self.states[wanted],
            covariances=self.covariances[wanted],
            begun_ns=self.begun_ns[wanted],
            seen_ns=self.seen_ns[wanted],
            num_seen=self.num_seen[wanted],
            scores=self.scores[wanted],
            points=self.points[is_chosen],
            owners=(np.cumsum(wanted) - 1)[self.owners[is_chosen]],
        )

    @classmethod
    def none(cls, stamp_ns: int, frame_id: str) -> Tracks:
        """Returns no tracks."""
        no_ints = np.zeros(0, np.int64)
        return cls(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            ids=no_ints,
            states=np.zeros((0, 2, 3)),
            covariances=np.zeros((0, 2, 2)),
            begun_ns=no_ints,
            seen_ns=no_ints,
            num_seen=no_ints,
            scores=np.zeros(0),
            points=np.zeros((0, 3)),
            owners=no_ints,
        )

    def joined(self, others: Tracks) -> Tracks:
        """Returns these and others of the same time."""
        return replace(
            self,
            **{
                name: np.concatenate([getattr(self, name), getattr(others, name)])
                for name in _COLUMNS
            },
            owners=np.concatenate([self.owners, others.owners + len(self)]),
        )

    def at(self, stamp_ns: int) -> Tracks:
        """Returns the tracks as they are expected at another time, not before their own."""
        elapsed_s = (stamp_ns - self.stamp_ns) / NANOSECONDS
        moved = elapsed_s * self.velocities
        states = self.states.copy()
        states[:, 0] += moved
        step = np.array([[1.0, elapsed_s], [0.0, 1.0]])
        push = np.array([elapsed_s**2 / 2, elapsed_s])
        noise = _ACCELERATION_M_S2**2 * (push[:, None] * push)
        return replace(
            self,
            stamp_ns=stamp_ns,
            states=states,
            covariances=product(product(step, self.covariances), step.T) + noise,
            points=self.points + moved[self.owners],
        )


_COLUMNS: Final = (
    "ids",
    "states",
    "covariances",
    "begun_ns",
    "seen_ns",
    "num_seen",
    "scores",
    "points",
)


def product(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns products of matrices (..., 2, 2); their order of summing is fixed."""
    product: NDArray[np.float64] = (left[..., :, :, None] * right[..., None, :, :]).sum(axis=-2)
    return product
