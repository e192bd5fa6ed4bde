# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Revolutions of a lidar whose clouds are parts of them: sectors, halves, or packets."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32
from mnsf_ros.settings import BufferSettings
from mnsf_ros.sweeps.range_view import NUM_AZIMUTHS, azimuths_of
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# So many points of a cloud show its directions; of fewer than the least, chance decides.
_MAX_POINTS: Final = 8192
_MIN_POINTS: Final = 200
# Gaps between directions that are no larger than most are between columns of the lidar.
_MOST: Final = 0.9
# Of the directions of the smaller cloud: neighbouring parts have less in common, whole clouds more.
_MIN_COMMON: Final = 0.5
# So many clouds in a row of other directions are parts, though those before were whole.
_NUM_APART: Final = 3


class Revolutions:
    """Groups the parts of a revolution, which see different directions one after the other.

    A revolution ends with the cloud that sees again what it has seen. Clouds that see all again are
    whole, and go on at once; so do the first ones, until the second shows that they are parts.
    """

    def __init__(self) -> None:
        self._parts: list[Sweep] = []
        self._seen: Bools = np.zeros(NUM_AZIMUTHS, np.bool_)
        self._last: Bools = self._seen
        self._frame_id: str | None = None
        self._are_whole = True
        # Clouds in a row of other directions than the one before; more to come are parts.
        self._num_apart = _NUM_APART - 1

    def add(self, sweep: Sweep, settings: BufferSettings) -> list[list[Sweep]]:
        """Takes the next cloud.

        Returns the revolutions that are complete by now, each as its parts. One without parts is a
        break: the clouds before it, taken for whole, were parts.
        """
        own = _directions(sweep.xyz)
        is_other = sweep.frame_id != self._frame_id
        is_again = is_other or _are_common(own, self._last)
        self._last, self._frame_id = own, sweep.frame_id
        if self._are_whole and is_other:
            return [[sweep]]
        if self._are_whole:
            self._num_apart = 0 if is_again else self._num_apart + 1
            if self._num_apart < _NUM_APART:
                return [[sweep]]
            self._are_whole, self._parts, self._seen = False, [sweep], own
            return [[]]
        is_known = len(sweep) >= _MIN_POINTS and _are_common(own, self._seen)
        if not is_known and self._continues(sweep, settings):
            self._parts.append(sweep)
            self._seen = self._seen | own
            return []
        done, self._parts, self._seen = self._parts, [sweep], own
        if len(done) == 1 and is_again:
            self._are_whole, self._parts, self._num_apart = True, [], 0
            return [done, [sweep]]
        return [done]

    @property
    def rest(self) -> list[Sweep]:
        """Returns the parts of the last revolution, which may not be complete."""
        return self._parts

    def _continues(self, sweep: Sweep, settings: BufferSettings) -> bool:
        """Whether a cloud may be of the same revolution, by frame and stamp."""
        first, before = self._parts[0], self._parts[-1]
        passed_s = (sweep.stamp_ns - first.stamp_ns) / NANOSECONDS
        is_later = sweep.stamp_ns > before.stamp_ns
        is_same = sweep.frame_id == first.frame_id
        return is_same and is_later and passed_s < settings.max_interval_s


def _are_common(own: Bools, seen: Bools) -> bool:
    """Whether directions were seen before; so if hardly any are known."""
    least = min(np.count_nonzero(own), np.count_nonzero(seen))
    return bool(np.count_nonzero(own & seen) >= _MIN_COMMON * least)


def _directions(xyz: Floats32) -> Bools:
    """(720,) from which azimuths points (N, 3) return; all for very few points."""
    if len(xyz) < _MIN_POINTS:
        return np.ones(NUM_AZIMUTHS, np.bool_)
    some = xyz[:: -(-len(xyz) // _MAX_POINTS)]
    # The origin may be metres from the lens: far points are nearly in the same direction from both.
    ranges = np.hypot(some[:, 0], some[:, 1])
    cells = np.unique(azimuths_of(some[ranges >= np.median(ranges)]))
    gaps = np.diff(cells, append=cells[0] + NUM_AZIMUTHS)
    reach = int(np.quantile(gaps, _MOST, method="lower"))
    seen: Bools = np.zeros(NUM_AZIMUTHS, np.bool_)
    for shift in range(1 - reach, reach):
        seen[(cells + shift) % NUM_AZIMUTHS] = True
    return seen
