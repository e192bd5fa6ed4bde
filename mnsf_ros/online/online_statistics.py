# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Counters of events, and figures of recent estimates."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mnsf_ros.core.flow_estimate import FlowEstimate

_WINDOW = 100
_NO_POINT = np.zeros(0, np.int64)


@dataclass(frozen=True)
class RecentEstimate:
    """Figures of one estimate."""

    finished_s: float  # of the steady clock
    latency_ms: float  # from the arrival of the next sweep to the publication of the flow
    estimate: FlowEstimate  # of no point

    @property
    def ego_source(self) -> str:
        """Source of the ego motion; empty if it is not known."""
        known = self.estimate.over_ground
        return "" if known is None else known.source


@dataclass(frozen=True)
class StatisticsSnapshot:
    """A copy of the statistics at one moment."""

    counts: Counter[str] = field(default_factory=Counter)  # how often each event happened
    recent: tuple[RecentEstimate, ...] = ()  # oldest first
    arrivals_s: tuple[float, ...] = ()  # steady times of the last sweeps received
    last_failure: str = ""  # of an estimate; empty if there was none
    failures_in_a_row: int = 0  # since the last estimate that did not fail

    def latency_ms(self, percentile: float) -> float:
        """Percentile of the recent latencies; NaN if there are none."""
        latencies = [item.latency_ms for item in self.recent]
        return float(np.percentile(latencies, percentile)) if latencies else float("nan")

    @property
    def estimate_ms(self) -> float:
        """Median run time of recent estimates; NaN if there are none."""
        times_ms = [item.estimate.time_ms for item in self.recent]
        return float(np.median(times_ms)) if times_ms else float("nan")

    def flow_rate_hz(self, now_s: float) -> float:
        """Flows published per second, recently."""
        return rate_hz([item.finished_s for item in self.recent], now_s)

    def input_rate_hz(self, now_s: float) -> float:
        """Sweeps received per second, recently."""
        return rate_hz(self.arrivals_s, now_s)


def rate_hz(times_s: Sequence[float], now_s: float) -> float:
    """Events per second of the given times; falls toward zero when no more come."""
    if len(times_s) < 2:
        return 0.0
    intervals = len(times_s) - 1
    silence_s = max(0.0, now_s - times_s[-1])
    usual_s = (times_s[-1] - times_s[0]) / intervals
    elapsed_s = times_s[-1] - times_s[0] + max(0.0, silence_s - usual_s)
    return intervals / elapsed_s if elapsed_s > 0 else 0.0


class OnlineStatistics:
    """Counters and recent figures; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._recent: deque[RecentEstimate] = deque(maxlen=_WINDOW)
        self._arrivals_s: deque[float] = deque(maxlen=_WINDOW)
        self._last_failure = ""
        self._failures_in_a_row = 0

    def count(self, event: str, times: int = 1) -> None:
        """Counts an event."""
        with self._lock:
            self._counts[event] += times

    def add_arrival(self) -> None:
        """Notes that a sweep was received now."""
        with self._lock:
            self._arrivals_s.append(time.monotonic())

    def add_failure(self, text: str) -> None:
        """Notes that an estimate failed."""
        with self._lock:
            self._last_failure = text
            self._failures_in_a_row += 1

    def add_estimate(self, latency_ms: float, estimate: FlowEstimate) -> None:
        """Notes that the flow of an estimate was published now."""
        item = RecentEstimate(time.monotonic(), latency_ms, estimate.part(_NO_POINT))
        with self._lock:
            self._recent.append(item)
            self._failures_in_a_row = 0

    def snapshot(self) -> StatisticsSnapshot:
        """A copy of all of it."""
        with self._lock:
            return StatisticsSnapshot(
                counts=self._counts.copy(),
                recent=tuple(self._recent),
                arrivals_s=tuple(self._arrivals_s),
                last_failure=self._last_failure,
                failures_in_a_row=self._failures_in_a_row,
            )
