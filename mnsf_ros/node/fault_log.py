"""Logging of faults that may come ten times a second: each kind at once, then at a low rate."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

PERIOD_S: Final = 600.0


@dataclass
class _Fault:
    """What is known of one kind of fault."""

    since: str
    said_s: float
    count: int = 1


class FaultLog:
    """Wraps a logger of rclpy; may be used from any thread.

    A fault is logged when it happens first. While it goes on it is logged again every ten minutes,
    with the number of times that it has happened.
    """

    def __init__(
        self,
        logger: Any,  # noqa: ANN401 - rclpy's logger type moves about
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._logger = logger
        self._clock = clock
        self._lock = threading.Lock()
        self._faults: dict[str, _Fault] = {}

    def warn(self, kind: str, text: str) -> None:
        """Warns of a fault, if it is time to."""
        suffix = self._suffix(kind)
        if suffix is not None:
            self._logger.warning(f"{text} {suffix}")

    def error(self, kind: str, text: str) -> None:
        """Logs an error, if it is time to."""
        suffix = self._suffix(kind)
        if suffix is not None:
            self._logger.error(f"{text} {suffix}")

    def _suffix(self, kind: str) -> str | None:
        """What to add to the text; None if nothing is to be said now."""
        now_s = self._clock()
        with self._lock:
            fault = self._faults.get(kind)
            if fault is None:
                since = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S")
                self._faults[kind] = _Fault(since, now_s)
                return f"(at most every {PERIOD_S / 60:.0f} min, counted in /diagnostics)"
            fault.count += 1
            if now_s - fault.said_s < PERIOD_S:
                return None
            fault.said_s = now_s
            return f"({fault.count:,} times since {fault.since})"
