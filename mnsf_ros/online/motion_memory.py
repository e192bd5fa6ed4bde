# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Memory from one estimate to the next: the tracks, and which of them go on."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mnsf_ros.online.sightings import Sightings
from mnsf_ros.online.tracks import MIN_SHARE, Track, alive, corrected, expecting_shares
from mnsf_ros.settings import WarmStartSettings
from mnsf_ros.sweeps.sweep import Start


class MotionMemory:
    """Remembers movers.

    Attributes:
        numbers: Those of tracks that begin.
    """

    def __init__(self, settings: WarmStartSettings, numbers: Iterator[int]) -> None:
        self._settings = settings
        self._tracks: list[Track] | None = None
        self.numbers = numbers

    @property
    def start(self) -> Start:
        """Where the next estimate starts."""
        if not self._settings.enabled:
            return Start.COLD_BY_SETTING
        return Start.COLD_FIRST if self._tracks is None else Start.WARM

    def follow(
        self, expected: Sequence[Track], seen: Sightings, stamp_ns: int, interval_s: float
    ) -> tuple[list[Track], NDArray[np.int64]]:
        """Assigns the sightings of the current sweep to the tracks, and updates the tracks.

        Args:
            expected: The tracks, see `expected`.
            seen: Things that move, or may move, in the sweep.
            stamp_ns: Time of the sweep.
            interval_s: Time to the next sweep.

        Returns:
            The tracks, and (G,) the number of the track of each of the things that were seen.
        """
        tracks, ids = follow(expected, seen, stamp_ns, self.numbers)
        if self._settings.enabled and interval_s > 0:
            self._tracks = tracks
        return tracks, ids

    def expected(self, stamp_ns: int, interval_s: float) -> list[Track]:
        """Returns the tracks predicted to a sweep, which is `interval_s` before the next one."""
        if self._tracks is None or interval_s <= 0:
            return []
        return alive(self._tracks, stamp_ns)


def follow(
    tracks: Sequence[Track], seen: Sightings, stamp_ns: int, numbers: Iterator[int]
) -> tuple[list[Track], NDArray[np.int64]]:
    """Returns the tracks after a sweep, and (G,) the number of the track of each of G things.

    Args:
        tracks: The tracks before, predicted to this sweep.
        seen: G things that move, or may move.
        stamp_ns: Time of the sweep.
        numbers: Those of tracks that begin here.
    """
    shares = expecting_shares(tracks, seen.points, seen.owners, len(seen))
    is_possible = shares > MIN_SHARE
    things, rows = _assigned(tracks, seen, shares, is_possible)
    after = corrected([tracks[row] for row in rows], seen.states[things], seen.variances[things])
    track_of = dict(zip(things.tolist(), after, strict=True))
    followed = []
    for thing, points in enumerate(seen.points_of_each):
        track = track_of.get(thing) or Track.begun(
            next(numbers), stamp_ns, seen.states[thing], seen.variances[thing]
        )
        score, is_mover = float(seen.scores[thing]), bool(seen.are_moving[thing])
        turn_rate = float(seen.turn_rates[thing])
        followed.append(track.seen(stamp_ns, points, score, turn_rate, moves=is_mover))
    # A track whose object became part of another one is not continued.
    unseen = [track for row, track in enumerate(tracks) if not is_possible[:, row].any()]
    ids = np.array([track.track_id for track in followed], np.int64)
    return sorted(unseen + followed, key=lambda track: track.track_id), ids


def _assigned(
    tracks: Sequence[Track],
    seen: Sightings,
    shares: NDArray[np.float64],
    is_possible: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns (A,) things that continue a track, and (A,) the rows of their tracks."""
    # Of two tracks at the same place the one seen more often continues.
    settled = 1 - 1 / (1 + np.array([track.num_seen for track in tracks]))
    # If the object of a track falls into parts, the largest part continues the track.
    sizes = np.bincount(seen.owners, minlength=len(seen))
    whole = np.array([max(len(track.points), 1) for track in tracks])
    met = shares * sizes[:, None]
    gains = is_possible * (met / (sizes[:, None] + whole - np.minimum(met, whole)) + settled)
    things, rows = linear_sum_assignment(gains, maximize=True)
    is_same = is_possible[things, rows]
    return things[is_same], rows[is_same]
