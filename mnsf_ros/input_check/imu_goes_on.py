# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the IMU goes on to send turn rates."""

from collections.abc import Iterator
from typing import Final

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.episodes import Episodes
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step
from mnsf_ros.sweeps.rate_track import are_covered

_ASSUMPTION: Final = "the IMU goes on"
# One message that is late costs one sweep.
_MIN_MISSED: Final = 3


class ImuGoesOn(Assumption):
    """Looks for turn rates that end."""

    def __init__(self, memory: float) -> None:
        """Starts without sweeps; see Episodes for `memory`."""
        self._num_missed, self._was_used = 0, False
        self._episodes = Episodes(memory)

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        sweep = step.after.sweep
        rates = sweep.turn_rates
        if rates is not None and are_covered(rates, *sweep.span_s):
            self._was_used, self._num_missed = True, 0
        elif self._was_used:
            self._num_missed += 1
        self._episodes.add(is_wrong=self._num_missed >= _MIN_MISSED)

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._episodes.num_wrong:
            found = f"turn rates of the IMU ended, or have gaps, {self._episodes.text}"
            remedy = (
                "Check the IMU, its driver and its clock; without it, sweeps are registered as of "
                "a sensor without an IMU"
            )
            yield Finding(_ASSUMPTION, Severity.WARNING, found, remedy)
