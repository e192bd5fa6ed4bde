# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Diagnoses from counters: missed clouds, the reason for no flow, a busy computer."""

from __future__ import annotations

import math
import os
import statistics
from collections import Counter, deque
from typing import Final, NamedTuple

from mnsf_ros.online.online_pipeline import (
    ESTIMATES_FAILED,
    FLOWS_OUT,
    SWEEPS_RECEIVED,
    TRIPLETS_DROPPED,
    TRIPLETS_UNWATCHED,
)
from mnsf_ros.online.online_statistics import StatisticsSnapshot

CLOUDS_UNDECODABLE: Final = "clouds_undecodable"
CLOUDS_EMPTY: Final = "clouds_empty"
CLOUDS_MISSED: Final = "clouds_missed"
SWEEPS_LOST: Final = "sweeps_lost_in_transport"

_ARRIVALS: Final = (SWEEPS_RECEIVED, CLOUDS_UNDECODABLE, CLOUDS_EMPTY)
# Signs that the node does what it should.
_WELL: Final = (FLOWS_OUT, TRIPLETS_UNWATCHED)

# Counter to what keeps the flow from coming if it grows.
_REASONS: Final = {
    "sweeps_frame_changed": "frame_id changes from sweep to sweep, as of two lidars on one topic",
    "sweeps_duplicate": "sweeps have the same stamp",
    "sweeps_out_of_order": "stamps go backwards",
    "sweeps_time_went_back": "stamps jump back again and again",
    "sweeps_gap": "sweeps are more than buffer.max_interval_s apart",
    CLOUDS_UNDECODABLE: "clouds cannot be decoded",
    CLOUDS_EMPTY: "clouds have no finite point",
    ESTIMATES_FAILED: "every estimate fails",
    TRIPLETS_DROPPED: "the estimate under way takes too long",
}

_WINDOW_S: Final = 10.0  # in which drops count

_NUM_INTERVALS: Final = 20
_LONG: Final = 1.5  # usual intervals: from here on at least one cloud is missing
_PAUSE: Final = 100  # usual intervals: from here on nothing was published


class FlowFaults(NamedTuple):
    """Faults of the flow as of now, a text each; empty if there is none."""

    complaint: str  # why none has come for longer than the patience
    busy: str  # which were dropped since the last look, and why


class FlowWatch:
    """Follows the counters of a pipeline; ask it again and again."""

    def __init__(self) -> None:
        # When it was asked, and the counts then: the last one is the newest, the first one the
        # oldest of the window.
        self._asked: deque[tuple[float, Counter[str]]] = deque([(-math.inf, Counter())])
        self._arrived_s = -math.inf
        # Since when clouds come without flow, and the counters then.
        self._since: tuple[float, Counter[str]] | None = None

    def look(self, snapshot: StatisticsSnapshot, now_s: float, patience_s: float) -> FlowFaults:
        """Returns what keeps flow from coming, as of now.

        Args:
            snapshot: The counters.
            now_s: Of a steady clock.
            patience_s: Time with clouds and without flow that is no reason to complain, and time
                without clouds after which none are expected.
        """
        last = self._asked[-1][1]
        new = snapshot.counts - last
        self._asked.append((now_s, snapshot.counts))
        while self._asked[1][0] <= now_s - _WINDOW_S:
            self._asked.popleft()
        if any(new[event] for event in _ARRIVALS):
            self._arrived_s = now_s
        is_silent = now_s - self._arrived_s > patience_s
        if is_silent or any(new[event] for event in _WELL):
            self._since = None
        elif self._since is None:
            self._since = now_s, last
        return FlowFaults(
            self._complaint(now_s - patience_s),
            self._busy(snapshot, now_s) if new[TRIPLETS_DROPPED] else "",
        )

    def _complaint(self, latest_s: float) -> str:
        if self._since is None or self._since[0] >= latest_s:
            return ""
        growth = self._asked[-1][1] - self._since[1]
        name = max(_REASONS, key=lambda name: growth[name])
        if not growth[name]:
            return "clouds come in, but no flow goes out"
        return f"no flow: {_REASONS[name]} (see {name})"

    def _busy(self, snapshot: StatisticsSnapshot, now_s: float) -> str:
        recent, cores = snapshot.counts - self._asked[0][1], os.cpu_count() or 1
        flows, rate_hz = recent[FLOWS_OUT], snapshot.input_rate_hz(now_s)
        possible = flows + recent[TRIPLETS_DROPPED]
        reasons = [f"load {os.getloadavg()[0]:.1f} on {cores} core{'' if cores == 1 else 's'}"]
        if rate_hz > 0:
            reasons.insert(0, f"sweeps come every {1e3 / rate_hz:.0f} ms")
        if math.isfinite(snapshot.estimate_ms):
            reasons.insert(0, f"an estimate takes {snapshot.estimate_ms:.0f} ms")
        return (
            f"CPU busy: {flows} of {possible} flows ({', '.join(reasons)}). "
            "Close other programs, or lower crop.max_range_m."
        )


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

    def expect_a_new_publisher(self) -> None:
        """Nobody publishes: what the next one sends before its first cloud arrives is missed."""
        self._last_number, self._last_publishers = 0, 0

    def before(self, number: int | None, stamp_ns: int, num_publishers: int) -> int:
        """Returns how many clouds are missing between the last one and this one.

        Args:
            number: That the publisher gave the cloud, one more each time; None if it is not known.
            stamp_ns: Of the cloud.
            num_publishers: Those of the topic, as of now.
        """
        is_one = max(num_publishers, self._last_publishers) <= 1
        missed = self._by_stamps(stamp_ns) if number is None else self._by_numbers(number)
        self._last_number, self._last_stamp_ns = number, stamp_ns
        self._last_publishers = num_publishers
        return missed if is_one else 0

    def _by_numbers(self, number: int) -> int:
        if self._last_number is None:
            return 0
        # A publisher that starts anew begins at 1.
        return number - 1 - (self._last_number if number > self._last_number else 0)

    def _by_stamps(self, stamp_ns: int) -> int:
        interval_ns = stamp_ns - self._last_stamp_ns
        is_full = len(self._intervals_ns) == _NUM_INTERVALS
        usual_ns = statistics.median(self._intervals_ns) if is_full else 0
        if self._last_stamp_ns and interval_ns > 0:
            self._intervals_ns.append(interval_ns)
        if not _LONG * usual_ns < interval_ns < _PAUSE * usual_ns:
            return 0
        return round(interval_ns / usual_ns) - 1
