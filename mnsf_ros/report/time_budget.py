"""How long pictures may take: an estimate that is not worth waiting for is not begun."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class TimeBudget:
    """Counts from its making on."""

    def __init__(
        self, limit_s: float = math.inf, known_s: Mapping[str, float] | None = None
    ) -> None:
        """Starts the clock.

        Args:
            limit_s: Seconds to be spent at most, but for the estimate that is under way then.
            known_s: Method to what one estimate took so far, seconds.
        """
        self.limit_s = limit_s
        self._start_s = time.monotonic()
        self._known_s = {k: s for k, s in (known_s or {}).items() if math.isfinite(s)}

    @property
    def left_s(self) -> float:
        """Seconds that are left."""
        return self.limit_s - (time.monotonic() - self._start_s)

    def needs_s(self, method: str) -> float:
        """Seconds that one more estimate may take."""
        return self._known_s.get(method, 0.0)

    def allows(self, method: str) -> bool:
        """Whether one more estimate of this method should get ready in time."""
        return self.needs_s(method) < self.left_s

    @contextmanager
    def estimate(self, method: str) -> Iterator[None]:
        """Learns from an estimate how long the next one may take."""
        start_s = time.monotonic()
        yield
        took_s = time.monotonic() - start_s
        self._known_s[method] = max(took_s, self.needs_s(method))
