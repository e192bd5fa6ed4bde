# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Association of movers with tracks, and the tracks after it."""

from collections.abc import Sequence
from itertools import count
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.tracks import Track, corrected, expecting_shares

# A thing is that of a track if more than this share of its points is where the track expects it.
_MIN_SHARE: Final = 0.2
# Of two tracks at the same place the one seen more often goes on, up to so many times.
_SETTLED: Final = 10
_PER_SETTLED: Final = 0.5


def follow(
    tracks: Sequence[Track], seen: Sightings, stamp_ns: int, next_id: int
) -> tuple[list[Track], NDArray[np.int64]]:
    """Returns the tracks after a sweep, and (G,) the number of the track of each of G things.

    Args:
        tracks: Those before, as they are expected in this sweep.
        seen: G things that move, or may move.
        stamp_ns: Time of the sweep.
        next_id: Number of the first track that begins here.
    """
    shares = expecting_shares(tracks, seen.points, seen.owners, len(seen))
    is_possible = shares > _MIN_SHARE
    things, rows = _assigned(tracks, seen, shares, is_possible)
    after = corrected([tracks[row] for row in rows], seen.states[things], seen.variances[things])
    track_of = dict(zip(things.tolist(), after, strict=True))
    numbers = count(next_id)
    followed = []
    for thing, points in enumerate(seen.points_of_each):
        track = track_of.get(thing) or Track.begun(
            next(numbers), stamp_ns, seen.states[thing], seen.variances[thing]
        )
        score, is_mover = float(seen.scores[thing]), bool(seen.are_moving[thing])
        followed.append(track.seen(stamp_ns, points, score, moves=is_mover))
    # What became a part of another thing is not followed by itself.
    unseen = [track for row, track in enumerate(tracks) if not is_possible[:, row].any()]
    ids = np.array([track.track_id for track in followed], np.int64)
    return sorted(unseen + followed, key=lambda track: track.track_id), ids


def _assigned(
    tracks: Sequence[Track],
    seen: Sightings,
    shares: NDArray[np.float64],
    is_possible: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns (A,) things that go on with a track, and (A,) the rows of their tracks."""
    num_seen = np.array([track.num_seen for track in tracks])
    settled = _PER_SETTLED * np.minimum(num_seen / _SETTLED, 1.0)
    # Of several parts of what a track was, the largest one goes on with its number.
    sizes = np.bincount(seen.owners, minlength=len(seen))
    whole = np.array([max(len(track.points), 1) for track in tracks])
    covered = np.minimum(shares * sizes[:, None] / whole, 1.0)
    gains = is_possible * (shares + covered + settled)
    things, rows = linear_sum_assignment(gains, maximize=True)
    is_same = is_possible[things, rows]
    return things[is_same], rows[is_same]
