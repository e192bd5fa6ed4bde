# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: header stamps are the times of the sweeps."""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step, SweepSample
from mnsf_ros.sweeps.sweep import NANOSECONDS

_ASSUMPTION: Final = "stamps are the times of the sweeps"
# At 10 m/s it is .05 m, the noise of registration.
_MAX_JITTER_S: Final = 0.005
_MIN_SWEEPS: Final = 8
# Speeds at which motion tells the interval; slower sensors shake as much as they move.
_MIN_SPEED_M_S: Final = 2.0
# How much better one clock must explain the motion than the other.
_CLEARLY: Final = 0.7
# Stamps around an even clock are off it by less than their intervals are.
_DRIFT: Final = 1.2
# Intervals that are so many times the median are gaps.
_GAP: Final = 1.5


class Stamps(Assumption):
    """Compares the intervals of stamps with an even clock, and both with the motion."""

    def __init__(self) -> None:
        self._stamps_s: deque[float] = deque(maxlen=200)
        self._starts_s: deque[float] = deque(maxlen=200)  # of the first points
        self._first_ns = 0
        self._steps: deque[tuple[float, float]] = deque(maxlen=200)  # seconds, metres

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        stamp_ns = sample.sweep.stamp_ns
        self._first_ns = self._first_ns or stamp_ns
        stamp_s, times_s = (stamp_ns - self._first_ns) / NANOSECONDS, sample.sweep.some_times_s
        first_s = 0.0
        if times_s is not None and len(times_s):
            # A single point may be early.
            first_s = np.sort(times_s)[len(times_s) // 100]
        self._stamps_s.append(stamp_s)
        self._starts_s.append(stamp_s + float(first_s))

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        self._steps.append((step.interval_s, step.way_m))

    def facts(self) -> dict[str, str]:
        """Rate and jitter, in words."""
        if len(self._stamps_s) < 2:
            return {}
        intervals_s = np.sort(np.diff(self._stamps_s))
        few = len(intervals_s) // 4  # gaps, and as many of the shortest
        rate_hz = 1 / max(float(intervals_s[few : len(intervals_s) - few].mean()), 1e-9)
        text = f"{rate_hz:.1f} Hz, stamps within {1e3 * _jitter_s(self._stamps_s):.1f} ms"
        gaps_s = intervals_s[intervals_s > _GAP * intervals_s[len(intervals_s) // 2]]
        gaps = f"; gaps: {len(gaps_s)}, up to {gaps_s[-1]:.1f} s" if len(gaps_s) else ""
        return {"rate": f"{text} of an even clock{gaps}"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if len(self._stamps_s) < _MIN_SWEEPS or self._jitter_s < _MAX_JITTER_S:
            return
        if not self._is_of_a_clock:
            low_s, high_s = np.quantile(np.diff(self._stamps_s), (0.05, 0.95))
            found = f"clouds come at uneven intervals of {low_s:.2f} to {high_s:.2f} s"
            remedy = "If they are keyframes nothing needs doing, as their stamps are used"
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)
            return
        found = f"stamps are up to {1e3 * self._jitter_s:.0f} ms off an even clock"
        severity = Severity.WARNING
        by_stamps_m, by_clock_m = self._unexplained_m()
        starts_s = _jitter_s(self._starts_s)
        if starts_s < _CLEARLY * self._jitter_s:
            severity = Severity.ERROR
            found += f", but the first points only {1e3 * starts_s:.0f} ms"
        elif by_clock_m < _CLEARLY * by_stamps_m:
            severity = Severity.ERROR
            found += (
                f", but the sensor moves evenly: {by_clock_m:.2f} m from the clock, "
                f"{by_stamps_m:.2f} m from the stamps"
            )
        remedy = "Let the driver use the time of the lidar, not the time of reception"
        yield Finding(_ASSUMPTION, severity, found, remedy)

    @property
    def _jitter_s(self) -> float:
        return _jitter_s(self._stamps_s)

    @property
    def _is_of_a_clock(self) -> bool:
        """Whether stamps stay near a line: late ones are followed by a short interval.

        The intervals of keyframes by distance follow the speed, and add up.
        """
        stamps_s = np.array(self._stamps_s)
        usual_s = np.median(np.diff(stamps_s))
        skipped = np.maximum(np.round(np.diff(stamps_s, prepend=stamps_s[0]) / (usual_s or 1.0)), 0)
        for ticks in (np.arange(len(stamps_s)), skipped.cumsum()):
            off_s = stamps_s - np.polyval(np.polyfit(ticks, stamps_s, 1), ticks)
            if np.quantile(np.abs(off_s), 0.9) < _DRIFT * self._jitter_s:
                return True
        return False

    def _unexplained_m(self) -> tuple[float, float]:
        """Metres of a step that the speed beside it leaves, by stamps and by an even clock."""
        if len(self._steps) < _MIN_SWEEPS:
            return 0.0, 0.0
        intervals_s, ways_m = np.array(self._steps).T
        usual_s = np.median(intervals_s)
        if np.median(ways_m) < _MIN_SPEED_M_S * usual_s:
            return 0.0, 0.0
        is_one = np.round(intervals_s / usual_s) == 1
        inner = np.flatnonzero(is_one[:-2] & is_one[1:-1] & is_one[2:]) + 1
        if len(inner) < _MIN_SWEEPS:
            return 0.0, 0.0
        beside_m = ways_m[inner - 1] + ways_m[inner + 1]
        by_stamps = (
            beside_m / (intervals_s[inner - 1] + intervals_s[inner + 1]) * intervals_s[inner]
        )
        return (
            float(np.median(np.abs(ways_m[inner] - by_stamps))),
            float(np.median(np.abs(ways_m[inner] - beside_m / 2))),
        )


def _jitter_s(times_s: Sequence[float]) -> float:
    """Nine of ten intervals are nearer to a multiple of the usual one."""
    intervals_s = np.diff(times_s)
    intervals_s = intervals_s[intervals_s > 0]
    if len(intervals_s) == 0:
        return 0.0
    usual_s = np.median(intervals_s)
    off_s = intervals_s - usual_s * np.round(intervals_s / usual_s)
    return float(np.quantile(np.abs(off_s), 0.9))
