# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracks: identity, position, velocity and covariance of movers from sweep to sweep."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.sweeps.sweep import NANOSECONDS

# Standard deviation of the acceleration of people and cars.
_ACCELERATION_M_S2: Final = 3.0
# A track ends if it was not seen for so long that it may be out of reach of where it is expected.
_MAX_UNSEEN_S: Final = np.sqrt(2 * REACH_M / _ACCELERATION_M_S2)
# A thing may continue a track if more than this share of its points is where the track predicts it.
MIN_SHARE: Final = 0.2


@dataclass(frozen=True, eq=False)
class Track:
    """State of a followed object that moves, or may move, in the world frame (Kalman filter).

    Attributes:
        track_id: Number from 1.
        stamp_ns: Time of state and points.
        begun_ns: When it was first seen to move.
        seen_ns: When it was last seen.
        num_seen: In how many sweeps it was seen to move.
        score: Log-odds that it moves, from all sweeps that showed it.
        state: (2, 3) place in metres and velocity in metres per second.
        turn_rate: Radians per second, to the left.
        covariance: (2, 2) of place and velocity, the same along each axis.
        points: (P, 3) metres, the points last seen, moved to the predicted place.
    """

    track_id: int
    stamp_ns: int
    begun_ns: int
    seen_ns: int
    num_seen: int
    score: float
    state: NDArray[np.float64]
    turn_rate: float
    covariance: NDArray[np.float64]
    points: NDArray[np.float64]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """(3,) metres per second."""
        return self.state[1]

    @classmethod
    def begun(
        cls,
        track_id: int,
        stamp_ns: int,
        state: NDArray[np.float64],
        variances: NDArray[np.float64],
    ) -> "Track":
        """A track that begins with a measured state and its variances (2,)."""
        nothing = np.zeros((0, 3))
        return cls(
            track_id, stamp_ns, stamp_ns, stamp_ns, 0, 0.0, state, 0.0, np.diag(variances), nothing
        )

    def seen(
        self,
        stamp_ns: int,
        points: NDArray[np.float64],
        score: float,
        turn_rate: float,
        *,
        moves: bool,
    ) -> "Track":
        """The track after it was seen again, its state already corrected."""
        return replace(
            self,
            begun_ns=self.begun_ns if self.num_seen else stamp_ns,
            seen_ns=stamp_ns,
            num_seen=self.num_seen + moves,
            score=score,
            # Prediction and measurement are about equally certain.
            turn_rate=(self.turn_rate + turn_rate) / 2,
            points=points,
        )


def _expected(tracks: Sequence[Track], stamp_ns: int) -> list[Track]:
    """Tracks predicted to another time, not before their own."""
    elapsed_s = np.array([stamp_ns - track.stamp_ns for track in tracks]) / NANOSECONDS
    steps = np.tile(np.eye(2), (len(tracks), 1, 1))
    steps[:, 0, 1] = elapsed_s
    pushes = _ACCELERATION_M_S2 * np.stack([elapsed_s**2 / 2, elapsed_s], axis=1)
    states = _product(steps, np.array([track.state for track in tracks]).reshape(-1, 2, 3))
    covariances = np.array([track.covariance for track in tracks]).reshape(-1, 2, 2)
    noise = pushes[:, :, None] * pushes[:, None]
    after = _product(_product(steps, covariances), steps.swapaxes(1, 2)) + noise
    return [
        replace(
            track,
            stamp_ns=stamp_ns,
            state=state,
            covariance=covariance,
            points=track.points + (state[0] - track.state[0]),
        )
        for track, state, covariance in zip(tracks, states, after, strict=True)
    ]


def corrected(
    tracks: Sequence[Track], states: NDArray[np.float64], variances: NDArray[np.float64]
) -> list[Track]:
    """K tracks after measurements of their states.

    Args:
        tracks: The tracks at the time of the measurements.
        states: (K, 2, 3) measured places and velocities.
        variances: (K, 2) of both.
    """
    expected = np.array([track.state for track in tracks]).reshape(-1, 2, 3)
    prior = np.array([track.covariance for track in tracks]).reshape(-1, 2, 2)
    total = prior + variances[:, :, None] * np.eye(2)
    gains = _product(prior, np.asarray(np.linalg.inv(total), np.float64))
    after = expected + _product(gains, states - expected)
    posterior = prior - _product(gains, prior)
    posterior = (posterior + posterior.swapaxes(1, 2)) / 2
    return [
        replace(track, state=state, covariance=covariance)
        for track, state, covariance in zip(tracks, after, posterior, strict=True)
    ]


def _product(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Products of matrices (K, 2, 2) and (K, 2, M); their order of summing is fixed."""
    return (left[:, :, :, None] * right[:, None]).sum(axis=2)


def alive(tracks: Sequence[Track], stamp_ns: int) -> list[Track]:
    """Tracks that may still be seen at a time, predicted to it."""
    limit_ns = stamp_ns - _MAX_UNSEEN_S * NANOSECONDS
    known = [track for track in tracks if limit_ns <= track.seen_ns <= stamp_ns]
    return _expected(known, stamp_ns)


def expecting_shares(
    tracks: Sequence[Track], points: NDArray[np.float64], owners: NDArray[np.int64], number: int
) -> NDArray[np.float64]:
    """Returns (number, K) share of each owner's points that is where each track predicts one.

    Args:
        tracks: K predicted tracks.
        points: (P, 3) metres, world.
        owners: (P,) int from 0 to `number` - 1.
        number: How many owners there are.
    """
    shares = np.zeros((number, len(tracks)))
    if number == 0 or len(tracks) == 0:
        return shares
    expected = np.concatenate([track.points for track in tracks])
    track_of = np.repeat(np.arange(len(tracks)), [len(track.points) for track in tracks])
    rows = PointGrid(expected).nearest(points)
    is_met = rows >= 0
    np.add.at(shares, (owners[is_met], track_of[rows[is_met]]), 1.0)
    shares /= np.maximum(np.bincount(owners, minlength=number), 1)[:, None]
    return shares
