# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages of a recording at the pace at which they were recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, TypeVar

from mnsf_ros.sweeps.sweep import NANOSECONDS

_CLOCK_PERIOD_S: Final = 0.025

Timed = TypeVar("Timed", bound=tuple[Any, ...])


def in_time(
    messages: Iterable[Timed],
    wait_s: Callable[[float], None],
    rate: float = 1.0,
    tell_time: Callable[[int], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Timed]:
    """Yields messages, which begin with their time in nanoseconds, each when it is due.

    Args:
        messages: In the order of time; the first one is due at once.
        wait_s: Waits for some seconds.
        rate: Speed over that of the recording, above 0.
        tell_time: Called with the time of the recording every 25 ms, if given.
        clock: Gives seconds.
    """
    start: tuple[int, float] | None = None
    for message in messages:
        time_ns = message[0]
        start_ns, start_s = start = start or (time_ns, clock())
        due_s = start_s + (time_ns - start_ns) / NANOSECONDS / rate
        while tell_time is not None and (left_s := due_s - clock()) > _CLOCK_PERIOD_S:
            tell_time(time_ns - round(left_s * rate * NANOSECONDS))
            wait_s(_CLOCK_PERIOD_S)
        wait_s(max(0.0, due_s - clock()))
        if tell_time is not None:
            tell_time(time_ns)
        yield message
