# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracks: identity, position, velocity and covariance of movers from sweep to sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.point_grid import PointGrid
from mnsf_ros.sweeps.sweep import NANOSECONDS

# Standard deviation of the acceleration of people and cars.
_ACCELERATION_M_S2: Final = 3.0
# A point is where a track expects one if it is this close.
_REACH_M: Final = 0.5
# A track ends if it was not seen to move for this long: it stopped, or is gone.
_MAX_UNSEEN_S: Final = 0.5
# With a slow sensor, for so many sweeps.
_MAX_UNSEEN_SWEEPS: Final = 2.5


@dataclass(frozen=True, eq=False)
class Track:
    """A mover that is followed, at one time, in the world (Kalman filter).

    Attributes:
        track_id: Number from 1.
        stamp_ns: Time of state and points.
        begun_ns: When it was first seen to move.
        seen_ns: When it was last seen to move.
        num_seen: In how many sweeps it was clearly seen to move.
        score: Logarithm of the odds that it moves, by the last sweep that showed it.
        state: (2, 3) place in metres and velocity in metres per second.
        covariance: (2, 2) of place and velocity, the same along each axis.
        points: (P, 3) metres, where it was last seen, moved to where it should be by now.
    """

    track_id: int
    stamp_ns: int
    begun_ns: int
    seen_ns: int
    num_seen: int
    score: float
    state: NDArray[np.float64]
    covariance: NDArray[np.float64]
    points: NDArray[np.float64]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """(3,) metres per second."""
        velocity: NDArray[np.float64] = self.state[1]
        return velocity

    def at(self, stamp_ns: int) -> Track:
        """The track as it is expected at another time, not before its own."""
        elapsed_s = (stamp_ns - self.stamp_ns) / NANOSECONDS
        moved = elapsed_s * self.velocity
        state = self.state.copy()
        state[0] += moved
        step = np.array([[1.0, elapsed_s], [0.0, 1.0]])
        push = _ACCELERATION_M_S2 * np.array([elapsed_s**2 / 2, elapsed_s])
        return replace(
            self,
            stamp_ns=stamp_ns,
            state=state,
            covariance=_product(_product(step, self.covariance), step.T) + np.outer(push, push),
            points=self.points + moved,
        )

    def corrected(self, state: NDArray[np.float64], variances: NDArray[np.float64]) -> Track:
        """The track after a measurement of its state, with variances (2,) of place and velocity."""
        total = self.covariance + np.diag(variances)
        gain = _product(self.covariance, np.asarray(np.linalg.inv(total), np.float64))
        posterior = self.covariance - _product(gain, self.covariance)
        return replace(
            self,
            state=self.state + _product(gain, state - self.state),
            covariance=(posterior + posterior.T) / 2,
        )


def _product(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Product of matrices; unlike that of a library, its order of summing is fixed."""
    product: NDArray[np.float64] = (left[:, :, None] * right).sum(axis=1)
    return product


def alive(tracks: Sequence[Track], stamp_ns: int, interval_s: float) -> list[Track]:
    """Tracks that may still be seen at a time, as they are expected then."""
    max_unseen_s = max(_MAX_UNSEEN_S, _MAX_UNSEEN_SWEEPS * interval_s)
    limit_ns = stamp_ns - max_unseen_s * NANOSECONDS
    return [track.at(stamp_ns) for track in tracks if track.seen_ns >= limit_ns]


def expecting_shares(
    tracks: Sequence[Track], points: NDArray[np.float64], owners: NDArray[np.int64], number: int
) -> NDArray[np.float64]:
    """Returns (number, K) which share of each owner's points is where each track expects one.

    Args:
        tracks: K tracks, as they are expected.
        points: (P, 3) metres, world.
        owners: (P,) int from 0 to `number` - 1.
        number: How many owners there are.
    """
    shares = np.zeros((number, len(tracks)))
    if number == 0 or len(tracks) == 0:
        return shares
    expected = np.concatenate([track.points for track in tracks])
    track_of = np.repeat(np.arange(len(tracks)), [len(track.points) for track in tracks])
    rows = PointGrid(expected).nearest(points, _REACH_M)
    is_met = rows >= 0
    np.add.at(shares, (owners[is_met], track_of[rows[is_met]]), 1.0)
    shares /= np.maximum(np.bincount(owners, minlength=number), 1)[:, None]
    return shares
