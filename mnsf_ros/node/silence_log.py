"""Says in the log that no sweep comes, where one could come from, and that sweeps come."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from mnsf_ros.node.diagnostics import InputState
from mnsf_ros.node.fault_log import PERIOD_S


class SilenceLog:
    """Logs one warning when no sweep comes for long, and one line when sweeps come.

    The warning is repeated after ten minutes at the earliest, as those of `FaultLog`.
    """

    def __init__(
        self,
        logger: Any,  # noqa: ANN401 - rclpy's logger type moves about
        find_topics: Callable[[], Sequence[str]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`find_topics` returns the topics of clouds that are published."""
        self._logger, self._find_topics, self._clock = logger, find_topics, clock
        self._start_s = clock()
        self._said_s: float | None = None
        self._is_waiting = True

    def look(self, arrivals_s: Sequence[float], state: InputState, stale_after_s: float) -> None:
        """Logs what is to be said now; `arrivals_s` are the times of the last sweeps."""
        now_s = self._clock()
        if state.pause:
            # Silence counts from the end of the pause on.
            self._start_s = now_s
            return
        last_s = max(self._start_s, arrivals_s[-1]) if arrivals_s else self._start_s
        if now_s - last_s > stale_after_s:
            if self._said_s is None or now_s - self._said_s >= PERIOD_S:
                self._logger.warning(self._warning(state, now_s - last_s))
                self._said_s, self._is_waiting = now_s, True
        elif self._is_waiting and last_s > self._start_s:
            self._logger.info(f"sweeps come on {state.topic}")
            self._is_waiting = False

    def _warning(self, state: InputState, silence_s: float) -> str:
        topics = ", ".join(self._find_topics())
        advice = (
            f"PointCloud2 topics that are published: {topics}"
            if topics
            else "no PointCloud2 topic is published, see ROS_DOMAIN_ID if one should be"
        )
        return (
            f"no sweep on {state.topic} for {silence_s:.0f} s; {advice} "
            f"(at most every {PERIOD_S / 60:.0f} min)"
        )
