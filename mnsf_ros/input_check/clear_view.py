# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: returns are of surfaces, not of fog, spray, or a hand on the lidar."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.episodes import Episodes
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.glance import NEAR_M, NUM_FIFTHS
from mnsf_ros.input_check.sweep_sample import RUN, SweepSample

_ASSUMPTION: Final = "returns are of surfaces"
# Three neighbours in the cloud are in a row of directions, too: radians, and shares of their way.
_MAX_WAY: Final = 0.1
_MAX_OFF: Final = 0.3
# Of the inverse of the range: along a plane it changes evenly, however slanted the plane is.
_MIN_BEND: Final = 0.2
_MIN_NEAR: Final = 0.4
# Of near points. With 70 % of the returns scattered within 4 m .43 to .9, .73 in the median of 33
# streams; without .38 at most in 61 streams, but for a single cloud with .51.
_MIN_SCATTERED: Final = 0.5
_MIN_TRIPLES: Final = 50
_NUM_DUE: Final = 2
# A door that closes and a wall that comes near take longer than these clouds.
_NUM_BEFORE: Final = 5
_NUM_NOW: Final = 3
_MAX_LEFT: Final = 0.5  # of the returns that are farther away
_MIN_RISE: Final = 0.25
_MIN_LOG: Final = np.log(1.5)


class ClearView(Assumption):
    """Looks for near returns that are scattered, or that are suddenly most of all.

    The walls of a small room are near, but they are surfaces, and come near in seconds.
    """

    def __init__(self, memory: float) -> None:
        """Starts without clouds; see Episodes for `memory`."""
        # Share of near returns, and logarithm of the usual range.
        self._near: deque[tuple[float, float]] = deque(maxlen=_NUM_BEFORE + _NUM_NOW)
        self._scattered: deque[bool] = deque(maxlen=_NUM_DUE)
        self._is_sudden = False
        self._before = 0.0
        self._share = 0.0
        self._episodes = Episodes(memory)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        if not sample.is_continued or sample.num_parts > 1:
            self._near.clear()
            self._is_sudden = False
        if sample.glance is None:
            return
        if sample.is_due:
            self._scattered.append(_are_scattered(sample))
        if sample.num_parts == 1:
            glance = sample.glance
            self._near.append((glance.near_share, glance.log_ranges[NUM_FIFTHS // 2]))
            self._compare()
        is_wrong = self._is_sudden or sum(self._scattered) == _NUM_DUE
        if is_wrong:
            self._share = sample.glance.near_share
        self._episodes.add(is_wrong=is_wrong)

    def _compare(self) -> None:
        if self._is_sudden:
            self._is_sudden = self._near[-1][0] > self._before + _MIN_RISE / 2
        elif len(self._near) == self._near.maxlen:
            shares, logs = zip(*self._near, strict=True)
            self._before, now = max(shares[:_NUM_BEFORE]), min(shares[_NUM_BEFORE:])
            are_few = 1 - now < _MAX_LEFT * (1 - self._before)
            are_nearer = max(logs[_NUM_BEFORE:]) < min(logs[:_NUM_BEFORE]) - _MIN_LOG
            self._is_sudden = are_few and are_nearer and now > self._before + _MIN_RISE

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._episodes.num_wrong:
            found = (
                f"{self._share:.0%} of the returns are within {NEAR_M:.0f} m, scattered or all of "
                f"a sudden, {self._episodes.text}"
            )
            remedy = (
                "If that is fog, spray or dust, or something on the lidar, what is behind it is "
                "not seen: drive slowly, clean the lidar"
            )
            yield Finding(_ASSUMPTION, Severity.WARNING, found, remedy)


def _are_scattered(sample: SweepSample) -> bool:
    """Whether many points are near, and not on surfaces with their neighbours."""
    number = len(sample.rows) // RUN * RUN
    if len(sample.sweep) <= number or number < _MIN_TRIPLES:
        return False
    xyz = sample.xyz[:number].reshape(-1, RUN, 3)
    ranges_m = np.maximum(np.linalg.norm(xyz, axis=2), 1e-9)
    if np.mean(ranges_m < NEAR_M) < _MIN_NEAR:
        return False
    directions, inverse = xyz / ranges_m[..., None], 1 / ranges_m
    # Of three in a row, the middle one is between the others, or tells nothing.
    way = directions[:, 2:] - directions[:, :-2]
    own = directions[:, 1:-1] - directions[:, :-2]
    lengths = np.maximum(np.linalg.norm(way, axis=2), 1e-9)
    places = np.einsum("rij,rij->ri", way, own) / lengths**2
    beside = np.linalg.norm(own - places[..., None] * way, axis=2)
    are_known = (np.abs(places - 0.5) < _MAX_OFF) & (beside < _MAX_OFF * lengths)
    are_known &= (lengths < _MAX_WAY) & (ranges_m[:, 1:-1] < NEAR_M)
    if np.count_nonzero(are_known) < _MIN_TRIPLES:
        return False
    expected = (1 - places) * inverse[:, :-2] + places * inverse[:, 2:]
    bend = np.abs(expected / inverse[:, 1:-1] - 1)
    return bool(np.mean(bend[are_known] > _MIN_BEND) > _MIN_SCATTERED)
