"""Logging that says each kind of thing once; how often it happened is in the diagnostics."""

from __future__ import annotations

import threading
from typing import Any


class OnceLog:
    """Wraps a logger of rclpy; may be used from any thread."""

    def __init__(self, logger: Any) -> None:  # noqa: ANN401 - rclpy's logger type moves about
        self._logger = logger
        self._lock = threading.Lock()
        self._said: set[str] = set()

    def warn(self, kind: str, text: str) -> None:
        """Warns, if it is the first of its kind."""
        if self._is_first(kind):
            self._logger.warning(f"{text} (said once, counted in /diagnostics)")

    def error(self, kind: str, text: str) -> None:
        """Logs an error, if it is the first of its kind."""
        if self._is_first(kind):
            self._logger.error(f"{text} (said once, counted in /diagnostics)")

    def _is_first(self, kind: str) -> bool:
        with self._lock:
            is_first = kind not in self._said
            self._said.add(kind)
        return is_first
