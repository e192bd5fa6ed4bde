# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages of a recording at the pace at which they were recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, TypeVar

from mnsf_ros.sweeps.sweep import NANOSECONDS

_CLOCK_PERIOD_S: Final = 0.025

Timed = TypeVar("Timed", bound=tuple[Any, ...])


class Pace:
    """The time of a recording, which passes from the first request on.

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


def in_time(
    messages: Iterable[Timed],
    pace: Pace,
    wait_s: Callable[[float], None],
    tell_time: Callable[[int], None] | None = None,
) -> Iterator[Timed]:
    """Yields messages, which begin with their time in nanoseconds, each when it is due.

    Args:
        messages: In the order of time.
        pace: The time of the recording.
        wait_s: Waits for some seconds, or not if they are negative.
        tell_time: Called with the time of the recording every 25 ms, if given.
    """
    for message in messages:
        time_ns = message[0]
        while tell_time is not None and (left_s := pace.left_s(time_ns)) > _CLOCK_PERIOD_S:
            tell_time(time_ns - round(left_s * pace.rate * NANOSECONDS))
            wait_s(min(left_s, _CLOCK_PERIOD_S))
        wait_s(pace.left_s(time_ns))
        if tell_time is not None:
            tell_time(time_ns)
        yield message
