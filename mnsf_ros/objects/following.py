# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Association of movers with tracks, and the tracks after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.tracks import Track, expecting_shares

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
        seen: G things that move.
        stamp_ns: Time of the sweep.
        next_id: Number of the first track that begins here.
    """
    shares = expecting_shares(tracks, seen.points, seen.owners, len(seen))
    is_possible = shares > _MIN_SHARE
    row_of = _assigned(tracks, seen, shares, is_possible)
    numbers = count(next_id)
    followed = []
    for thing, points in enumerate(seen.points_of_each):
        state, variances = seen.states[thing], seen.variances[thing]
        if thing in row_of:
            track = tracks[row_of[thing]].corrected(state, variances)
        else:
            covariance, begun = np.diag(variances), (stamp_ns, stamp_ns)
            track = Track(next(numbers), *begun, stamp_ns, 0, 0.0, state, covariance, points)
        num_seen = track.num_seen + int(seen.are_clear[thing])
        score = float(seen.scores[thing])
        followed.append(
            replace(track, seen_ns=stamp_ns, num_seen=num_seen, score=score, points=points)
        )
    # What became a part of another thing is not followed by itself.
    unseen = [track for row, track in enumerate(tracks) if not is_possible[:, row].any()]
    ids = np.array([track.track_id for track in followed], np.int64)
    return sorted(unseen + followed, key=lambda track: track.track_id), ids


def _assigned(
    tracks: Sequence[Track],
    seen: Sightings,
    shares: NDArray[np.float64],
    is_possible: NDArray[np.bool_],
) -> dict[int, int]:
    """Returns thing to row of its track, for those that have one."""
    num_seen = np.array([track.num_seen for track in tracks])
    settled = _PER_SETTLED * np.minimum(num_seen / _SETTLED, 1.0)
    # Of several parts of what a track was, the largest one goes on with its number.
    sizes = np.bincount(seen.owners, minlength=len(seen))
    whole = np.array([max(len(track.points), 1) for track in tracks])
    covered = np.minimum(shares * sizes[:, None] / whole, 1.0)
    gains = is_possible * (shares + covered + settled)
    pairs = zip(*linear_sum_assignment(gains, maximize=True), strict=True)
    return {int(thing): int(row) for thing, row in pairs if is_possible[thing, row]}
