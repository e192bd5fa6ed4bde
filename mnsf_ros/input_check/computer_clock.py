# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the lidar and the computer have the same time."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample
from mnsf_ros.sweeps.sweep import NANOSECONDS

_ASSUMPTION: Final = "lidar and computer have the same time"
# A sweep takes .2 s at most, and a queue of five sweeps half a second.
_MAX_OFF_S: Final = 1.0
_NUM_LAST: Final = 5
# Older stamps are those of a recording or a simulator, more often than of a clock that was set.
_DAY_S: Final = 86_400.0


class ComputerClock(Assumption):
    """Compares the stamp of each cloud with the time at which it was received.

    Attributes:
        is_played: Whether the clouds come from a program that plays recordings.
    """

    def __init__(self, *, is_live: bool) -> None:
        """Starts without clouds."""
        self.is_played = False
        self._is_live = is_live
        self._ages_s: deque[float] = deque(maxlen=_NUM_LAST)
        self._last_ns = 0

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        stamp_ns, last_ns = sample.sweep.stamp_ns, self._last_ns
        self._last_ns = stamp_ns
        if stamp_ns <= last_ns:
            # Stamps that stay or go back are those of no clock.
            self._ages_s.clear()
        # Under use_sim_time the clock stands at 0 until somebody publishes it.
        if sample.cloud is not None and sample.cloud.is_stamped and sample.cloud.received_ns:
            self._ages_s.append((sample.cloud.received_ns - stamp_ns) / NANOSECONDS)

    def facts(self) -> dict[str, str]:
        """Age of the stamps, in words."""
        if len(self._ages_s) < _NUM_LAST:
            return {}
        return {"age of stamps": f"{np.median(self._ages_s):.2f} s when received"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if len(self._ages_s) < _NUM_LAST:
            return
        least_s, most_s = min(self._ages_s), max(self._ages_s)
        if least_s <= _MAX_OFF_S and most_s >= -_MAX_OFF_S:
            return
        age_s = float(np.median(self._ages_s))
        side = "behind" if age_s > 0 else "ahead of"
        found = f"stamps are {_duration(abs(age_s))} {side} the clock of the computer"
        if age_s > 0 and (self.is_played or age_s > _DAY_S):
            found += ", as those of a recording that is played"
            remedy = (
                "If it is one, publish its clock (--clock) and set use_sim_time where TF or "
                "other sensors need it; else synchronise the lidar by PTP or NTP"
            )
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)
            return
        remedy = (
            "Synchronise lidar and computer by PTP or NTP, or let the driver stamp by the clock of "
            "the computer; for a recording, publish its clock (--clock) and set use_sim_time"
        )
        severity = Severity.ERROR if self._is_live else Severity.WARNING
        yield Finding(_ASSUMPTION, severity, found, remedy)


def _duration(seconds: float) -> str:
    """A duration in the largest unit of which it has two."""
    for name, size in (("days", _DAY_S), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:,.1f} {name}"
    return f"{seconds:.1f} s"
