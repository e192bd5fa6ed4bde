# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: each cloud is measured anew."""

from collections import deque
from collections.abc import Iterator
from typing import Final

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.episodes import Episodes
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample

_ASSUMPTION: Final = "each cloud is measured anew"
# A driver that hangs repeats its last cloud, or the buffers that it fills in turn.
_NUM_BEFORE: Final = 4
# Of the last clouds so many repeat one: a network may deliver one twice. At 10 Hz it is .3 s.
_NUM_LAST: Final = 6
_MIN_REPEATED: Final = 3


class FreshClouds(Assumption):
    """Compares the fingerprint of each cloud with those just before it."""

    def __init__(self, memory: float) -> None:
        """Starts without clouds; see Episodes for `memory`."""
        self._before: deque[bytes] = deque(maxlen=_NUM_BEFORE)
        self._are_repeated: deque[bool] = deque(maxlen=_NUM_LAST)
        self._episodes = Episodes(memory)
        self._last_ns: int | None = None

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        # One that comes twice under its own stamp is a duplicate, which the flow tells.
        is_duplicate = sample.sweep.stamp_ns == self._last_ns
        self._last_ns = sample.sweep.stamp_ns
        if len(sample.sweep) == 0 or is_duplicate:
            return
        fingerprint = sample.sweep.fingerprint
        self._are_repeated.append(fingerprint in self._before)
        self._before.append(fingerprint)
        self._episodes.add(is_wrong=sum(self._are_repeated) >= _MIN_REPEATED)

    @property
    def is_alarm(self) -> bool:
        """Whether the flow is wrong from now on."""
        return self._episodes.is_now

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._episodes.num_wrong:
            found = (
                f"the points are those of an earlier cloud under a new stamp {self._episodes.text}"
            )
            remedy = (
                "Restart the driver, and check the power and the network of the lidar; in a "
                "simulator without noise a robot that stands sees the same: nothing needs doing"
            )
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)
