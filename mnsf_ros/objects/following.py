# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Association of movers with tracks, and the update of the tracks."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mnsf_ros.objects.point_grid import PointGrid
from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.tracks import Tracks, product
from mnsf_ros.sweeps.sweep import NANOSECONDS

# A point is where a track expects one if it is this close.
_REACH_M: Final = 0.5
# A thing is that of a track if more than this share of its points is where the track expects it.
_MIN_SHARE: Final = 0.2
# Of two tracks at the same place the one seen more often goes on, up to so many times.
_SETTLED: Final = 10
_PER_SETTLED: Final = 0.5
# A track ends if it was not seen to move for this long: it stopped, or is gone.
_MAX_UNSEEN_S: Final = 0.5
# With a slow sensor, for so many sweeps.
_MAX_UNSEEN_SWEEPS: Final = 2.5


def alive(tracks: Tracks, stamp_ns: int, interval_s: float) -> Tracks:
    """Returns the tracks that may still be seen at a time, as they are expected then."""
    max_unseen_s = max(_MAX_UNSEEN_S, _MAX_UNSEEN_SWEEPS * interval_s)
    is_alive = stamp_ns - tracks.seen_ns <= max_unseen_s * NANOSECONDS
    return tracks.only(is_alive).at(stamp_ns)


def expecting_shares(
    tracks: Tracks, points: NDArray[np.float64], owners: NDArray[np.int64], number: int
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
    rows = PointGrid(tracks.points).nearest(points, _REACH_M)
    is_met = rows >= 0
    np.add.at(shares, (owners[is_met], tracks.owners[rows[is_met]]), 1.0)
    shares /= np.maximum(np.bincount(owners, minlength=number), 1)[:, None]
    return shares


def follow(tracks: Tracks, seen: Sightings, next_id: int) -> tuple[Tracks, NDArray[np.int64]]:
    """Returns the tracks after a sweep, and (G,) the number of the track of each of G things.

    Args:
        tracks: Those before, as they are expected in this sweep.
        seen: G things that move.
        next_id: Number of the first track that begins here.
    """
    shares = expecting_shares(tracks, seen.points, seen.owners, len(seen))
    is_possible: NDArray[np.bool_] = shares > _MIN_SHARE
    settled = _PER_SETTLED * np.minimum(tracks.num_seen / _SETTLED, 1.0)
    # Of several parts of what a track was, the largest one goes on with its number.
    sizes = np.bincount(seen.owners, minlength=len(seen))
    whole = np.maximum(np.bincount(tracks.owners, minlength=len(tracks)), 1)
    covered = np.minimum(shares * sizes[:, None] / whole, 1.0)
    gains = is_possible * (shares + covered + settled)
    things, rows = linear_sum_assignment(gains, maximize=True)
    is_same = is_possible[things, rows]
    things, rows = things[is_same], rows[is_same]
    is_new = np.ones(len(seen), dtype=bool)
    is_new[things] = False
    ids = np.zeros(len(seen), np.int64)
    ids[things] = tracks.ids[rows]
    ids[is_new] = next_id + np.arange(np.count_nonzero(is_new))
    # What became a part of another thing is not followed by itself.
    goes_on: NDArray[np.bool_] = ~np.any(is_possible, axis=0, keepdims=True)[0]
    goes_on[rows] = True
    after = _updated(tracks, rows, seen, things).only(goes_on)
    return after.joined(_begun(tracks, seen, is_new, ids)), ids


def _updated(
    tracks: Tracks, rows: NDArray[np.int64], seen: Sightings, things: NDArray[np.int64]
) -> Tracks:
    """Returns the tracks with some rows corrected by sightings (Kalman update)."""
    prior, noise = tracks.covariances[rows], seen.variances[things]
    total = prior.copy()
    total[:, 0, 0] += noise[:, 0]
    total[:, 1, 1] += noise[:, 1]
    gain = product(prior, np.asarray(np.linalg.inv(total), np.float64))
    states, covariances = tracks.states.copy(), tracks.covariances.copy()
    states[rows] += product(gain, seen.states[things] - tracks.states[rows])
    posterior = prior - product(gain, prior)
    covariances[rows] = (posterior + posterior.swapaxes(1, 2)) / 2
    seen_ns, num_seen = tracks.seen_ns.copy(), tracks.num_seen.copy()
    seen_ns[rows] = tracks.stamp_ns
    num_seen[rows] += seen.are_clear[things]
    scores = tracks.scores.copy()
    scores[rows] = seen.scores[things]
    points, owners = _replaced_points(tracks, rows, seen, things)
    return replace(
        tracks,
        states=states,
        covariances=covariances,
        seen_ns=seen_ns,
        num_seen=num_seen,
        scores=scores,
        points=points,
        owners=owners,
    )


def _replaced_points(
    tracks: Tracks, rows: NDArray[np.int64], seen: Sightings, things: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Returns points of the tracks and their owners; some rows have new points."""
    is_old = ~np.isin(tracks.owners, rows)
    row_of = np.full(len(seen), -1)
    row_of[things] = rows
    is_seen = row_of[seen.owners] >= 0
    points = np.concatenate([tracks.points[is_old], seen.points[is_seen]])
    owners = np.concatenate([tracks.owners[is_old], row_of[seen.owners[is_seen]]])
    order = np.argsort(owners, kind="stable")
    return points[order], owners[order]


def _begun(
    tracks: Tracks, seen: Sightings, is_new: NDArray[np.bool_], ids: NDArray[np.int64]
) -> Tracks:
    """Returns the tracks that begin in this sweep, of the things of a (G,) mask."""
    number = int(np.count_nonzero(is_new))
    now_ns = np.full(number, tracks.stamp_ns, np.int64)
    is_chosen = is_new[seen.owners]
    return Tracks(
        stamp_ns=tracks.stamp_ns,
        frame_id=tracks.frame_id,
        ids=ids[is_new],
        states=seen.states[is_new],
        covariances=seen.variances[is_new][:, :, None] * np.eye(2),
        begun_ns=now_ns,
        seen_ns=now_ns,
        num_seen=seen.are_clear[is_new].astype(np.int64),
        scores=seen.scores[is_new],
        points=seen.points[is_chosen],
        owners=(np.cumsum(is_new) - 1)[seen.owners[is_chosen]],
    )
