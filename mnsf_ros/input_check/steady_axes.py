# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the axes of the clouds stay: a mirrored lidar seems to turn the other way round."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.episodes import Episodes
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import RUN, SweepSample

_ASSUMPTION: Final = "the axes of the clouds stay"
_MIN_SAMPLES: Final = 2
# Of the steps between neighbours, more go one way than the other by so much.
_MIN_ORDER: Final = 0.5
_SIDEWAYS: Final = (1e-4, 0.2)  # radians, between columns


class SteadyAxes(Assumption):
    """Compares the direction in which points go around with that at first.

    It is known by their times, or by their order in the cloud, and the same in all clouds of one
    lidar.
    """

    def __init__(self, memory: float) -> None:
        """Starts without clouds; see Episodes for `memory`."""
        self._usual, self._last, self._num_same = 0, 0, 0
        self._episodes = Episodes(memory)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        if sample.is_due and len(sample.xyz) and (sense := _sense_of(sample)):
            self._num_same = self._num_same + 1 if sense == self._last else 1
            self._last = sense
            if self._num_same >= _MIN_SAMPLES:
                self._usual = self._usual or sense
        is_wrong = self._num_same >= _MIN_SAMPLES and self._last != self._usual
        self._episodes.add(is_wrong=is_wrong)

    @property
    def is_alarm(self) -> bool:
        """Whether the flow is wrong from now on."""
        return self._episodes.is_now

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._episodes.num_wrong:
            now, before = ("counter", "") if self._usual < 0 else ("", "counter")
            found = (
                f"points go around {now}clockwise, after {before}clockwise at first, "
                f"{self._episodes.text}: clouds are mirrored"
            )
            remedy = (
                "Check that no axis of the driver has the wrong sign; if the lidar was told to "
                "turn the other way, call ~/reset"
            )
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)


def _sense_of(sample: SweepSample) -> int:
    """1: counterclockwise, as seen from above; -1: clockwise; 0: unknown."""
    if sample.turn is not None:
        return sample.turn.sense
    if len(sample.sweep) <= len(sample.rows):
        return 0
    azimuths = sample.azimuths[: len(sample.rows) // RUN * RUN].reshape(-1, RUN)
    # Along a beam neighbours go around; where a column comes after the other, columns do.
    for steps in (np.diff(azimuths, axis=1).ravel(), np.diff(azimuths[:, 0])):
        sizes = np.abs(steps)
        signs = np.sign(steps[(sizes > _SIDEWAYS[0]) & (sizes < _SIDEWAYS[1])])
        if len(signs) > len(azimuths) // 2 and abs(signs.mean()) > _MIN_ORDER:
            return int(np.sign(signs.mean()))
    return 0
