"""Tells that the computer is too busy to keep up with the sensor, and what to do."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Mapping
from typing import Final

from mnsf_ros.online.online_pipeline import FLOWS_OUT, TRIPLETS_DROPPED
from mnsf_ros.online.online_statistics import StatisticsSnapshot

_WINDOW_S: Final = 10.0


class BusyWatch:
    """Follows the counters of a pipeline; ask it again and again."""

    def __init__(self) -> None:
        # When it was asked, and the counts of flows and drops then; the first one is the oldest.
        self._asked: deque[tuple[float, int, int]] = deque([(-math.inf, 0, 0)])

    def warning(self, snapshot: StatisticsSnapshot, now_s: float) -> str:
        """Returns a sentence if triplets were dropped since the last call, else nothing."""
        flows, dropped = _ends(snapshot.counts)
        has_dropped = dropped > self._asked[-1][2]
        self._asked.append((now_s, flows, dropped))
        while self._asked[1][0] <= now_s - _WINDOW_S:
            self._asked.popleft()
        if not has_dropped:
            return ""
        _, flows_before, dropped_before = self._asked[0]
        rate_hz = snapshot.input_rate_hz(now_s)
        interval_ms = 1e3 / rate_hz if rate_hz > 0 else math.nan
        return busy_text(
            flows - flows_before, dropped - dropped_before, snapshot.estimate_ms, interval_ms
        )


def busy_text(num_flows: int, num_dropped: int, estimate_ms: float, interval_ms: float) -> str:
    """Says how many sweeps were dropped, why, and what to do. Times that are NaN are left out."""
    cores = os.cpu_count() or 1
    reasons = [
        f"an estimate takes {estimate_ms:.0f} ms" if math.isfinite(estimate_ms) else "",
        f"sweeps come every {interval_ms:.0f} ms" if math.isfinite(interval_ms) else "",
        f"load {os.getloadavg()[0]:.1f} on {cores} core{'' if cores == 1 else 's'}",
    ]
    return (
        f"CPU busy: {num_flows} of {num_flows + num_dropped} flows "
        f"({', '.join(reason for reason in reasons if reason)}). "
        "Close other programs, or lower crop.max_range_m."
    )


def _ends(counts: Mapping[str, int]) -> tuple[int, int]:
    return counts.get(FLOWS_OUT, 0), counts.get(TRIPLETS_DROPPED, 0)
