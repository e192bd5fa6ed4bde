# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the unit of the coordinates stays."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.episodes import Episodes
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.glance import NUM_FIFTHS
from mnsf_ros.input_check.sweep_sample import SweepSample

_ASSUMPTION: Final = "the unit of the coordinates stays"
# From one cloud to the next no view becomes so much nearer or farther at all ranges alike.
_MIN_LOG: Final = np.log(1.4)
_MAX_SPREAD: Final = 0.25
_MIDDLE: Final = NUM_FIFTHS // 2
_NUM_BEFORE: Final = 5
_NUM_NOW: Final = 3
# Of the number of points: a change of view changes it, a change of unit does not.
_MAX_LOG_NUMBER: Final = np.log(1.3)


class SteadyScale(Assumption):
    """Looks for a cloud whose ranges are those before, times one factor."""

    def __init__(self, memory: float) -> None:
        """Starts without clouds; see Episodes for `memory`."""
        # Logarithms of ranges and of the number of points.
        self._last: deque[Floats] = deque(maxlen=_NUM_BEFORE + _NUM_NOW)
        self._log = 0.0  # of the scale over that at first
        self._factor = 1.0
        self._episodes = Episodes(memory)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        if not sample.is_continued or sample.num_parts > 1:
            self._last.clear()
        if sample.num_parts > 1 or (glance := sample.glance) is None:
            return
        self._last.append(np.append(glance.log_ranges, np.log(glance.num_points)))
        if len(self._last) == self._last.maxlen and (log := self._change()):
            self._log += log
            self._last.clear()
            if abs(self._log) > _MIN_LOG:
                self._factor = float(np.exp(self._log))
        self._episodes.add(is_wrong=abs(self._log) > _MIN_LOG)

    def _change(self) -> float:
        """Logarithm of the factor, if all was steady before it and after it; else 0."""
        step = self._last[_NUM_BEFORE] - self._last[_NUM_BEFORE - 1]
        if abs(float(step[_MIDDLE])) < _MIN_LOG:
            return 0.0
        last = np.array(self._last)
        before, now = last[:_NUM_BEFORE], last[_NUM_BEFORE:]
        if max(_noise(before), _noise(now)) > _MIN_LOG:
            return 0.0
        *logs, log_number = np.median(now, axis=0) - np.median(before, axis=0)
        is_one = np.ptp(logs) < _MAX_SPREAD and abs(log_number) < _MAX_LOG_NUMBER
        return float(np.median(logs)) if is_one else 0.0

    @property
    def is_alarm(self) -> bool:
        """Whether the flow is wrong from now on."""
        return self._episodes.is_now

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._episodes.num_wrong:
            found = (
                f"from one cloud to the next all ranges became {self._factor:.2g} times what they "
                f"were, {self._episodes.text}"
            )
            remedy = "Check the unit and the scale of the driver: coordinates are in metres"
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)


def _noise(logs: Floats) -> float:
    """The largest change among some clouds."""
    return float(np.ptp(logs, axis=0).max())
