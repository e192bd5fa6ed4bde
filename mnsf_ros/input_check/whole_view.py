# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the lidar goes on seeing all directions that it saw before."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Ints
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.episodes import Episodes
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.glance import NUM_SIDES
from mnsf_ros.input_check.sweep_sample import SweepSample

_ASSUMPTION: Final = "the lidar sees what it saw before"
# Of the sides of 15 degrees so many beside each other are gone: 60 degrees.
_MIN_GONE: Final = 4
_NUM_BEFORE: Final = 50
_MIN_BEFORE: Final = 20
_NUM_NOW: Final = 3
# Of the usual number of points; below it a side, or the cloud, is gone. In 70 simulated streams and
# those of eleven real lidars at least .4 and .7 were left, past buses and in and out of tunnels.
_GONE: Final = 0.1
_FEW: Final = 0.25
# It is back above this.
_BACK: Final = 0.5
# It had so many all the time before.
_STEADY: Final = 0.3
# A side that has hardly a point of a glance tells nothing.
_MIN_SHARE: Final = 0.01


class WholeView(Assumption):
    """Compares the number of points in each direction with that before.

    Surfaces that come nearer, such as a bus alongside, give returns in the same directions.
    """

    def __init__(self, memory: float) -> None:
        """Starts without clouds; see Episodes for `memory`."""
        self._before: deque[Floats] = deque(maxlen=_NUM_BEFORE)
        self._now: deque[Floats] = deque(maxlen=_NUM_NOW)
        self._usual: Floats = np.zeros(NUM_SIDES)
        self._are_steady: Bools = np.zeros(NUM_SIDES, np.bool_)
        self._gone: Bools = self._are_steady
        self._is_few, self._most_empty = False, 0
        self._share = 1.0
        self._sides, self._clouds = Episodes(memory), Episodes(memory)
        self._gone_deg, self._middle_deg = 0.0, 0.0

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        if not sample.is_continued or sample.num_parts > 1:
            self._before.clear()
            self._now.clear()
            self._usual = np.zeros(NUM_SIDES)
            self._gone, self._is_few = np.zeros(NUM_SIDES, np.bool_), False
        if sample.num_parts > 1 or sample.glance is None:
            return
        if len(self._now) == _NUM_NOW and not self._is_gone:
            self._before.append(self._now[0])
        self._now.append(sample.glance.num_by_side)
        if sample.is_due and not self._is_gone and len(self._before) >= _MIN_BEFORE:
            self._learn(np.array(self._before))
        if len(self._now) == _NUM_NOW and self._usual.any():
            self._compare(sum(self._now, np.zeros(NUM_SIDES)) / _NUM_NOW)

    @property
    def _is_gone(self) -> bool:
        return self._is_few or bool(self._gone.any())

    def _learn(self, before: Floats) -> None:
        """Takes what is usual from the clouds before."""
        self._usual = np.median(before, axis=0)
        # Means of three clouds, as of now.
        smooth = (before[2:] + before[1:-1] + before[:-2]) / 3
        self._are_steady = smooth.min(axis=0) > _STEADY * self._usual
        self._are_steady &= self._usual > _MIN_SHARE * self._usual.sum()
        self._most_empty = int(self._num_empty(smooth).max())

    def _num_empty(self, numbers: Floats) -> Ints:
        """(...) how many sides of numbers of points (..., 24) have hardly any."""
        return np.count_nonzero(numbers < _GONE * self._usual.mean(), axis=-1)

    def _compare(self, now: Floats) -> None:
        number, usual_number = float(now.sum()), float(self._usual.sum())
        if self._is_gone:
            self._gone = _in_a_row(self._gone & (now < _BACK * self._usual))
            self._is_few = self._is_few and number < _BACK * usual_number
        else:
            gone = self._are_steady & (now < _GONE * self._usual)
            # Where a side without returns turns along, as many sides have returns again.
            if gone.any() and self._num_empty(now) >= self._most_empty + _MIN_GONE:
                self._gone = _in_a_row(gone)
            self._is_few = number < _FEW * usual_number
        if self._is_few:
            # The least: when they come back, means are of few points and of many.
            self._share = min(number / usual_number, self._share if self._clouds.is_now else 1.0)
        elif self._gone.any():
            self._gone_deg = 360 / NUM_SIDES * np.count_nonzero(self._gone)
            angles = 2 * np.pi * (np.flatnonzero(self._gone) + 0.5) / NUM_SIDES
            self._middle_deg = float(np.degrees(np.angle(np.exp(1j * angles).sum())))
        self._clouds.add(is_wrong=self._is_few)
        self._sides.add(is_wrong=self._is_gone and not self._is_few)

    @property
    def is_alarm(self) -> bool:
        """Whether flow is missing from now on."""
        return self._clouds.is_now or self._sides.is_now

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._clouds.num_wrong:
            found = f"only {self._share:.1%} of the points before are left {self._clouds.text}"
            remedy = "Clean the lidar, and check what covers it, its settings and its network"
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)
        if self._sides.num_wrong:
            found = (
                f"{self._gone_deg:.0f} degrees around azimuth {round(self._middle_deg)} have no "
                f"returns any more {self._sides.text}"
            )
            remedy = "Clean the window of the lidar there, and check what covers it and its view"
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)


def _in_a_row(are_gone: Bools) -> Bools:
    """The sides (24,) that are gone with so many beside them, around the circle."""
    kept = np.zeros_like(are_gone)
    for start in range(NUM_SIDES):
        row = np.arange(start, start + _MIN_GONE) % NUM_SIDES
        if are_gone[row].all():
            kept[row] = True
    return kept
