"""When the messages of a recording are due while it is played."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Final, TypeVar

Item = TypeVar("Item")

_NANOSECONDS: Final = 1e9


class Pace:
    """The time of a recording, which passes from now on."""

    def __init__(
        self, first_ns: int, rate: float = 1.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Starts at a time of the recording; with a rate of 2 it passes twice as fast."""
        self._first_ns, self._rate, self._clock = first_ns, rate, clock
        self._start_s = clock()

    @property
    def now_ns(self) -> int:
        """Which time of the recording it is now."""
        passed_s = (self._clock() - self._start_s) * self._rate
        return self._first_ns + round(passed_s * _NANOSECONDS)

    def left_s(self, time_ns: int) -> float:
        """Seconds until a time of the recording; negative if it has passed."""
        due_s = (time_ns - self._first_ns) / _NANOSECONDS / self._rate
        return self._start_s + due_s - self._clock()


def paced(
    messages: Iterable[tuple[int, Item]],
    wait: Callable[[float], None],
    clock: Callable[[], float] = time.monotonic,
    rate: float = 1.0,
) -> Iterator[tuple[int, Item]]:
    """Returns messages with their times in nanoseconds, each when it is due.

    `wait` is called with the seconds until then, which may be negative. With a `rate` of 2 they
    are due in half the time.
    """
    pace: Pace | None = None
    for time_ns, item in messages:
        pace = pace or Pace(time_ns, rate, clock)
        wait(pace.left_s(time_ns))
        yield time_ns, item
