# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Counters of events, and figures of recent estimates."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mnsf_ros.core.flow_estimate import FlowEstimate

_WINDOW = 100
_NO_POINT = np.zeros(0, np.int64)


@dataclass(frozen=True)
class RecentEstimate:
    """Figures of one estimate."""

    latency_ms: float  # from the arrival of the next sweep to the publication of the flow
    estimate: FlowEstimate  # of no point

    @property
    def ego_source(self) -> str:
        """Source of the ego motion; empty if it is not known."""
        known = self.estimate.over_ground
        return "" if known is None else known.source


@dataclass(frozen=True)
class StatisticsSnapshot:
    """The statistics at one moment; never changed."""

    counts: Counter[str] = field(default_factory=Counter)  # how often each event happened
    last_s: Mapping[str, float] = field(default_factory=dict)  # when, by `time.monotonic()`
    recent: tuple[RecentEstimate, ...] = ()  # oldest first
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


class OnlineStatistics:
    """Counters and recent figures; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now = StatisticsSnapshot()

    def count(self, event: str, times: int = 1) -> None:
        """Counts an event."""
        with self._lock:
            counts = self._now.counts + Counter({event: times})
            last_s = {**self._now.last_s, event: time.monotonic()}
            self._now = replace(self._now, counts=counts, last_s=last_s)

    def add_failure(self, text: str) -> None:
        """Notes that an estimate failed."""
        with self._lock:
            number = self._now.failures_in_a_row + 1
            self._now = replace(self._now, last_failure=text, failures_in_a_row=number)

    def add_estimate(self, latency_ms: float, estimate: FlowEstimate) -> None:
        """Notes that the flow of an estimate was published now."""
        item = RecentEstimate(latency_ms, estimate.part(_NO_POINT))
        with self._lock:
            recent = (*self._now.recent, item)[-_WINDOW:]
            self._now = replace(self._now, recent=recent, failures_in_a_row=0)

    def snapshot(self) -> StatisticsSnapshot:
        """All of it as of now."""
        return self._now
