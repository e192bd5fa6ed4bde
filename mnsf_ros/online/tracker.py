# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The tracker: a Kalman filter for each mover, and which measurements continue which track."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from mnsf_ros.arrays import Bools, Floats, Ints
from mnsf_ros.core.reason import Verdict
from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.online.motions import TrackPrior
from mnsf_ros.online.object_points import NOISE_M, ObjectPoints
from mnsf_ros.online.table import ObjectTable, sums_by_group
from mnsf_ros.online.turning import turns_of
from mnsf_ros.settings import WarmStartSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Start

# Standard deviation of the acceleration of people and cars.
_ACCELERATION_M_S2: Final = 3.0
# A track ends if it was not seen for so long that it may be out of reach of where it is predicted.
_MAX_UNSEEN_S: Final = np.sqrt(2 * REACH_M / _ACCELERATION_M_S2)
# A group may continue a track if more than this share of its points is where the track predicts it.
_MIN_SHARE: Final = 0.2
# Standard deviation of a motion that the points constrain.
_MOTION_M: Final = 0.03
# If shifted motions raise the residual by this, twice the noise, the points constrain the motion.
_CLEAR_RISE_M: Final = 2 * NOISE_M


@dataclass(frozen=True, eq=False)
class Measurements:
    """G groups of objects that move, or may move, alike, in the world frame.

    Attributes:
        states: (G, 2, 3) middle of the points in metres, velocity in metres per second.
        variances: (G, 2) of place and velocity along each axis.
        turn_rates: (G,) radians per second, to the left.
        log_odds: (G,) that they move, of their likeliest object.
        are_moving: (G,) whether they have an object that is called dynamic.
        points: (P, 3) metres.
        owners: (P,) int from 0 to G - 1, rising.
    """

    states: Floats
    variances: Floats
    turn_rates: Floats
    log_odds: Floats
    are_moving: Bools
    points: Floats
    owners: Ints

    @classmethod
    def of(cls, table: ObjectTable, world_from_sensor: Floats, interval_s: float) -> "Measurements":
        """Returns the groups of a table.

        Args:
            table: Objects of the current sweep, some of them in groups.
            world_from_sensor: (4, 4) pose of the sensor.
            interval_s: Time to the next sweep, above 0.
        """
        followed = table.select(table.followed_rows)
        objects, groups, num_groups = followed.points, followed.groups, table.num_groups
        order = np.argsort(groups[objects.owners], kind="stable")
        points = transformed(objects.positions, world_from_sensor)[order].astype(np.float64)
        owners = groups[objects.owners][order]
        counts = objects.counts.astype(np.float64)
        weights = np.bincount(groups, counts, num_groups)[:, None]
        centers = sums_by_group(points, owners, num_groups) / weights
        velocities = turned(table.group_motions, world_from_sensor[:3, :3]) / interval_s
        # The middle of the visible points shifts when another side comes into view.
        spread = np.sqrt(
            sums_by_group((points - centers[owners]) ** 2, owners, num_groups) / weights
        )
        place_errors = spread.max(axis=1, initial=0.0)
        # If shifted motions hardly raise the residual, the velocity is uncertain.
        rises = np.bincount(groups, counts * followed.residual_rise, num_groups) / weights[:, 0]
        velocity_errors = _MOTION_M / interval_s / np.clip(rises / _CLEAR_RISE_M, 1e-3, 1.0)
        turn_rates, log_odds = np.zeros(num_groups), np.full(num_groups, -np.inf)
        turn_rates[groups] = turns_of(followed.linear_motions) / interval_s
        np.maximum.at(log_odds, groups, followed.log_odds)
        return cls(
            states=np.stack([centers, velocities], axis=1),
            variances=np.stack([place_errors, velocity_errors], axis=1) ** 2,
            turn_rates=turn_rates,
            log_odds=log_odds,
            are_moving=np.bincount(groups, followed.verdicts == Verdict.DYNAMIC, num_groups) > 0,
            points=points,
            owners=owners,
        )

    def __len__(self) -> int:
        return len(self.states)

    @property
    def points_of_each(self) -> list[Floats]:
        """(P, 3) metres of each group."""
        starts = np.searchsorted(self.owners, np.arange(1, len(self)))
        return np.split(self.points, starts) if len(self) else []


@dataclass(frozen=True, eq=False)
class Track:
    """State of a followed group that moves, or may move, in the world frame (Kalman filter).

    Attributes:
        track_id: Number from 1.
        stamp_ns: Time of state and points.
        moving_since_ns: When it was first seen to move.
        seen_ns: When it was last seen.
        num_moving: Number of sweeps in which it was seen to move.
        log_odds: That it moves, from all sweeps that showed it.
        state: (2, 3) place in metres and velocity in metres per second.
        turn_rate: Radians per second, to the left.
        covariance: (2, 2) of place and velocity, the same along each axis.
        points: (P, 3) metres, the points last seen, moved to the predicted place.
    """

    track_id: int
    stamp_ns: int
    moving_since_ns: int
    seen_ns: int
    num_moving: int
    log_odds: float
    state: Floats
    turn_rate: float
    covariance: Floats
    points: Floats

    @property
    def velocity(self) -> Floats:
        """(3,) metres per second."""
        return self.state[1]

    @classmethod
    def begun(cls, track_id: int, stamp_ns: int, state: Floats, variances: Floats) -> "Track":
        """A track that begins with a measured state and its variances (2,)."""
        nothing = np.zeros((0, 3))
        return cls(
            track_id, stamp_ns, stamp_ns, stamp_ns, 0, 0.0, state, 0.0, np.diag(variances), nothing
        )

    def seen(
        self, stamp_ns: int, points: Floats, log_odds: float, turn_rate: float, *, moves: bool
    ) -> "Track":
        """The track after it was seen again, its state already corrected."""
        return replace(
            self,
            moving_since_ns=self.moving_since_ns if self.num_moving else stamp_ns,
            seen_ns=stamp_ns,
            num_moving=self.num_moving + moves,
            log_odds=log_odds,
            # Prediction and measurement are about equally certain.
            turn_rate=(self.turn_rate + turn_rate) / 2,
            points=points,
        )


class Tracker:
    """Keeps the tracks from one estimate to the next.

    Attributes:
        new_ids: The ids of tracks that begin.
    """

    def __init__(self, settings: WarmStartSettings, new_ids: Iterator[int]) -> None:
        self._settings = settings
        self._tracks: list[Track] | None = None
        self.new_ids = new_ids

    @property
    def start(self) -> Start:
        """Where the next estimate starts."""
        if not self._settings.enabled:
            return Start.COLD_BY_SETTING
        return Start.COLD_FIRST if self._tracks is None else Start.WARM

    def predicted(self, stamp_ns: int, interval_s: float) -> list[Track]:
        """Returns the tracks predicted to a sweep, which is `interval_s` before the next one."""
        if self._tracks is None or interval_s <= 0:
            return []
        earliest_ns = stamp_ns - _MAX_UNSEEN_S * NANOSECONDS
        recent = [track for track in self._tracks if earliest_ns <= track.seen_ns <= stamp_ns]
        return _predicted(recent, stamp_ns)

    def update(
        self, tracks: Sequence[Track], measured: Measurements, stamp_ns: int, interval_s: float
    ) -> tuple[list[Track], Ints]:
        """Continues tracks with the measurements of a sweep, and begins new ones.

        Args:
            tracks: Result of `predicted` for the sweep; a track that is not among them ends.
            measured: G groups of objects that move, or may move, in the sweep.
            stamp_ns: Time of the sweep.
            interval_s: Time to the next sweep.

        Returns:
            The tracks after the sweep, and (G,) the `track_id` of each group.
        """
        shares = _shares_at_tracks(tracks, measured.points, measured.owners, len(measured))
        may_continue = shares > _MIN_SHARE
        groups, continued = _assigned(tracks, measured, shares, may_continue)
        corrected = _corrected(
            [tracks[index] for index in continued],
            measured.states[groups],
            measured.variances[groups],
        )
        track_of = dict(zip(groups.tolist(), corrected, strict=True))
        followed = []
        for group, points in enumerate(measured.points_of_each):
            track = track_of.get(group) or Track.begun(
                next(self.new_ids), stamp_ns, measured.states[group], measured.variances[group]
            )
            log_odds, turn_rate = float(measured.log_odds[group]), float(measured.turn_rates[group])
            moves = bool(measured.are_moving[group])
            followed.append(track.seen(stamp_ns, points, log_odds, turn_rate, moves=moves))
        # A track whose object became part of another one is not continued.
        unseen = [track for index, track in enumerate(tracks) if not may_continue[:, index].any()]
        after = sorted(unseen + followed, key=lambda track: track.track_id)
        if self._settings.enabled and interval_s > 0:
            self._tracks = after
        return after, np.array([track.track_id for track in followed], np.int64)


def track_prior(
    tracks: Sequence[Track], objects: ObjectPoints, world_from_sensor: Floats, interval_s: float
) -> TrackPrior:
    """Returns the prior of the motions of K objects, from tracks predicted to their sweep.

    Args:
        tracks: The tracks.
        objects: K objects.
        world_from_sensor: (4, 4) pose of the sensor.
        interval_s: Time to the next sweep.
    """
    some, prior = objects.thinner(), TrackPrior.without_tracks(len(objects))
    if len(some) == 0 or len(tracks) == 0:
        return prior
    points = transformed(some.positions, world_from_sensor).astype(np.float64)
    all_shares = _shares_at_tracks(tracks, points, some.owners, len(some))
    rows = np.flatnonzero(all_shares.max(axis=1) > _MIN_SHARE)
    best = all_shares.argmax(axis=1)[rows]
    velocities = np.stack([track.velocity for track in tracks])
    velocities = turned(velocities, world_from_sensor[:3, :3].T)
    variances = np.array([track.covariance[1, 1] for track in tracks])
    return prior.put(
        rows,
        shares=all_shares[rows, best],
        motions=velocities[best] * interval_s,
        turn_rates=np.array([track.turn_rate for track in tracks])[best],
        log_odds=np.array([track.log_odds for track in tracks])[best],
        deviations_m=np.sqrt(variances[best]) * interval_s,
    )


def _predicted(tracks: Sequence[Track], stamp_ns: int) -> list[Track]:
    """Tracks at another time, not before their own; constant velocity."""
    elapsed_s = np.array([stamp_ns - track.stamp_ns for track in tracks]) / NANOSECONDS
    transitions = np.tile(np.eye(2), (len(tracks), 1, 1))
    transitions[:, 0, 1] = elapsed_s
    pushes = _ACCELERATION_M_S2 * np.stack([elapsed_s**2 / 2, elapsed_s], axis=1)
    states = _product(transitions, np.array([track.state for track in tracks]).reshape(-1, 2, 3))
    covariances = np.array([track.covariance for track in tracks]).reshape(-1, 2, 2)
    noise = pushes[:, :, None] * pushes[:, None]
    after = _product(_product(transitions, covariances), transitions.swapaxes(1, 2)) + noise
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


def _corrected(tracks: Sequence[Track], states: Floats, variances: Floats) -> list[Track]:
    """Predicted tracks after measurements of their states (K, 2, 3) with variances (K, 2)."""
    predicted = np.array([track.state for track in tracks]).reshape(-1, 2, 3)
    prior = np.array([track.covariance for track in tracks]).reshape(-1, 2, 2)
    total = prior + variances[:, :, None] * np.eye(2)
    gains = _product(prior, np.asarray(np.linalg.inv(total), np.float64))
    after = predicted + _product(gains, states - predicted)
    posterior = prior - _product(gains, prior)
    posterior = (posterior + posterior.swapaxes(1, 2)) / 2
    return [
        replace(track, state=state, covariance=covariance)
        for track, state, covariance in zip(tracks, after, posterior, strict=True)
    ]


def _product(left: Floats, right: Floats) -> Floats:
    """Products of matrices (K, 2, 2) and (K, 2, M); their order of summing is fixed."""
    return (left[:, :, :, None] * right[:, None]).sum(axis=2)


def _shares_at_tracks(
    tracks: Sequence[Track], points: Floats, owners: Ints, num_owners: int
) -> Floats:
    """Returns (num_owners, K) the share of each owner's points that each track predicts.

    Args:
        tracks: K predicted tracks.
        points: (P, 3) metres, world.
        owners: (P,) int from 0 to `num_owners` - 1.
        num_owners: How many owners there are.
    """
    shares = np.zeros((num_owners, len(tracks)))
    if num_owners == 0 or len(tracks) == 0:
        return shares
    predicted = np.concatenate([track.points for track in tracks])
    track_of = np.repeat(np.arange(len(tracks)), [len(track.points) for track in tracks])
    nearest = PointGrid(predicted).nearest(points)
    is_near = nearest >= 0
    np.add.at(shares, (owners[is_near], track_of[nearest[is_near]]), 1.0)
    shares /= np.maximum(np.bincount(owners, minlength=num_owners), 1)[:, None]
    return shares


def _assigned(
    tracks: Sequence[Track], measured: Measurements, shares: Floats, may_continue: Bools
) -> tuple[Ints, Ints]:
    """Returns (A,) groups that continue a track, and (A,) the indices of their tracks."""
    # Of two tracks at the same place the one seen more often continues.
    seniority = 1 - 1 / (1 + np.array([track.num_moving for track in tracks]))
    # If the object of a track falls into parts, the largest part continues the track.
    sizes = np.bincount(measured.owners, minlength=len(measured))
    track_sizes = np.array([max(len(track.points), 1) for track in tracks])
    met = shares * sizes[:, None]
    intersection_over_union = met / (sizes[:, None] + track_sizes - np.minimum(met, track_sizes))
    # Both are from 0 to 1 and have the same weight.
    gains = may_continue * (intersection_over_union + seniority)
    groups, continued = linear_sum_assignment(gains, maximize=True)
    is_same = may_continue[groups, continued]
    return groups[is_same], continued[is_same]
