"""How many clouds were published that the node never saw."""

from __future__ import annotations

import statistics
from collections import deque
from typing import Final

_NUM_INTERVALS: Final = 20
_LONG: Final = 1.5  # usual intervals: from here on at least one cloud is missing
_PAUSE: Final = 100  # usual intervals: from here on nothing was published


class MissedClouds:
    """Counts by the numbers of a publisher, or by stamps where the middleware gives no numbers.

    A queue of a subscription overwrites the oldest cloud without a word. With more than one
    publisher there is no telling.
    """

    def __init__(self) -> None:
        self._last_number: int | None = None
        self._last_stamp_ns = 0
        self._last_publishers = 0
        self._intervals_ns: deque[int] = deque(maxlen=_NUM_INTERVALS)

    def before(self, number: int | None, stamp_ns: int, num_publishers: int) -> int:
        """Returns how many clouds are missing between the last one and this one.

        Args:
            number: That the publisher gave the cloud, one more each time; None if it is not known.
            stamp_ns: Of the cloud.
            num_publishers: Those of the topic, as of now.
        """
        is_one = num_publishers == self._last_publishers == 1
        if number is None:
            missed = self._by_stamps(stamp_ns)
        else:
            # A publisher that starts anew begins at 1.
            missed = max(0, number - self._last_number - 1) if self._last_number else 0
        self._last_number, self._last_stamp_ns = number, stamp_ns
        self._last_publishers = num_publishers
        return missed if is_one else 0

    def _by_stamps(self, stamp_ns: int) -> int:
        interval_ns = stamp_ns - self._last_stamp_ns
        is_full = len(self._intervals_ns) == _NUM_INTERVALS
        usual_ns = statistics.median(self._intervals_ns) if is_full else 0
        if self._last_stamp_ns and interval_ns > 0:
            self._intervals_ns.append(interval_ns)
        if not _LONG * usual_ns < interval_ns < _PAUSE * usual_ns:
            return 0
        return round(interval_ns / usual_ns) - 1
