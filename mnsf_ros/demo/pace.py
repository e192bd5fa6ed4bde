# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""When the messages of a recording are due while it is played."""

from __future__ import annotations

import time
from collections.abc import Callable

from mnsf_ros.sweeps.sweep import NANOSECONDS


class Pace:
    """The time of a recording, which passes from the first one on that is asked for.

    Attributes:
        rate: With 2 it passes twice as fast.
    """

    def __init__(self, rate: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        """Waits for the first time; `clock` gives seconds."""
        self.rate = rate
        self._clock = clock
        self._start: tuple[int, float] | None = None

    def left_s(self, time_ns: int) -> float:
        """Seconds until a time of the recording; negative if it has passed."""
        now_s = self._clock()
        if self._start is None:
            self._start = time_ns, now_s
        first_ns, start_s = self._start
        return start_s + (time_ns - first_ns) / NANOSECONDS / self.rate - now_s
