# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Revolutions of a lidar whose clouds are parts of them: sectors, halves, or packets."""

from collections import deque
from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32, Ints, Ints32
from mnsf_ros.settings import BufferSettings
from mnsf_ros.sweeps.range_view import NUM_AZIMUTHS, azimuths_of
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# So many points show the directions of a cloud; of fewer than the least, chance decides whether
# clouds are parts: those of several clouds are taken together.
_MAX_POINTS: Final = 8192
_MIN_POINTS: Final = 200
# Fewer points do not tell where a part is.
_FEWEST: Final = 10
# Directions, 30 degrees. In a frame metres from the lens, narrower parts see much of what those
# just before saw: they are compared with parts that were over 90 degrees ago, at least.
_NARROW: Final = NUM_AZIMUTHS * 30 // 360
_AGO: Final = NUM_AZIMUTHS * 90 // 360
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
        self._seen = _Seen()
        self._last: Bools = np.zeros(NUM_AZIMUTHS, np.bool_)
        # Points of clouds that are too small to be compared one by one.
        self._small: list[Floats32] = []
        self._frame_id: str | None = None
        self._are_whole = True
        # Clouds in a row of other directions than the one before; more to come are parts.
        self._num_apart = _NUM_APART - 1

    def add(self, sweep: Sweep, settings: BufferSettings) -> list[list[Sweep]]:
        """Takes the next cloud.

        Returns the revolutions that are complete by now, each as its parts. One without parts is a
        break: the clouds before it, taken for whole, were parts.
        """
        is_other, self._frame_id = sweep.frame_id != self._frame_id, sweep.frame_id
        own = _cells(sweep.xyz)
        is_again = self._is_again(sweep.xyz) or is_other
        if self._are_whole and is_other:
            return [[sweep]]
        if self._are_whole:
            self._num_apart = 0 if is_again else self._num_apart + (not self._small)
            if self._num_apart < _NUM_APART:
                return [[sweep]]
            self._are_whole, self._parts, self._seen = False, [sweep], _Seen(own)
            return [[]]
        is_known = len(sweep) >= _FEWEST and self._seen.has(own)
        if not is_known and self._continues(sweep, settings):
            self._parts.append(sweep)
            self._seen.add(own)
            return []
        done, self._parts, self._seen = self._parts, [sweep], _Seen(own)
        if len(done) == 1 and is_again:
            self._are_whole, self._parts, self._num_apart = True, [], 0
            return [done, [sweep]]
        return [done]

    @property
    def rest(self) -> list[Sweep]:
        """Returns the parts of the last revolution, which may not be complete."""
        return self._parts

    def _is_again(self, xyz: Floats32) -> bool:
        """Whether clouds see what those before saw; False as long as they are too small to tell."""
        self._small.append(xyz)
        if sum(map(len, self._small)) < _MIN_POINTS:
            return False
        own = _filled(_cells(np.concatenate(self._small)))
        last, self._last, self._small = self._last, own, []
        return _are_common(own, last)

    def _continues(self, sweep: Sweep, settings: BufferSettings) -> bool:
        """Whether a cloud may be of the same revolution, by frame and stamp."""
        first, before = self._parts[0], self._parts[-1]
        passed_s = (sweep.stamp_ns - first.stamp_ns) / NANOSECONDS
        is_later = sweep.stamp_ns > before.stamp_ns
        is_same = sweep.frame_id == first.frame_id
        return is_same and is_later and passed_s < settings.max_interval_s


class _Seen:
    """The directions of the parts of a revolution: all of them, and those of 90 degrees ago."""

    def __init__(self, *parts: Ints32) -> None:
        """Starts with the directions of some parts, each (K,) cells."""
        self._all: Bools = np.zeros(NUM_AZIMUTHS, np.bool_)
        self._ago: Bools = self._all.copy()
        self._late: deque[Ints32] = deque()
        self._num_late: Ints = np.zeros(NUM_AZIMUTHS, np.int64)  # parts that see a direction
        for cells in parts:
            self.add(cells)

    def add(self, cells: Ints32) -> None:
        """Takes the next part, (K,) cells."""
        self._all[cells] = True
        self._late.append(cells)
        self._num_late[cells] += 1
        while True:
            first = self._late[0]
            self._num_late[first] -= 1
            if np.count_nonzero(self._num_late) < _AGO:
                self._num_late[first] += 1
                return
            self._ago[first] = True
            self._late.popleft()

    def has(self, cells: Ints32) -> bool:
        """Whether most directions of a part, (K,) cells, were seen before."""
        own = _filled(cells)
        if np.count_nonzero(own) < _NARROW:
            ago = _filled(np.flatnonzero(self._ago))
            return bool(2 * np.count_nonzero(ago[cells]) > len(cells))
        return _are_common(own, _filled(np.flatnonzero(self._all)))


def _are_common(own: Bools, seen: Bools) -> bool:
    """Whether directions were seen before; so if hardly any are known."""
    least = min(np.count_nonzero(own), np.count_nonzero(seen))
    return bool(np.count_nonzero(own & seen) >= _MIN_COMMON * least)


def _cells(xyz: Floats32) -> Ints32:
    """(K,) the azimuths, as cells, from which the farther half of points (N, 3) return."""
    some = xyz[:: max(1, -(-len(xyz) // _MAX_POINTS))]
    # The origin may be metres from the lens: far points are nearly in the same direction from both.
    ranges = np.hypot(some[:, 0], some[:, 1])
    farther = some[ranges >= np.median(ranges)] if len(some) else some
    return np.unique(azimuths_of(farther))


def _filled(cells: Ints32 | Ints) -> Bools:
    """(720,) the directions of cells (K,), with the gaps between columns of the lidar."""
    seen: Bools = np.zeros(NUM_AZIMUTHS, np.bool_)
    if len(cells) == 0:
        return seen
    gaps = np.diff(cells, append=cells[0] + NUM_AZIMUTHS)
    reach = int(np.quantile(gaps, _MOST, method="lower"))
    for shift in range(1 - reach, reach):
        seen[(cells + shift) % NUM_AZIMUTHS] = True
    return seen
