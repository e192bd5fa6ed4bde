# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: each point has the time of its measurement, or all have the same."""

from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step, SweepSample

_ASSUMPTION: Final = "each point has its time of measurement"
# Lidars turn at 5 to 20 Hz, a few at 30.
_MAX_RATE_HZ: Final = 35.0
# Mean length of the unit vectors of the phase between time and azimuth. Lidars that turn have more
# than .97, packets of 10 ms .98, others .3 at most.
_TURNING: Final = 0.9
# Of a turn. In 1/25 of .1 s a sensor of 10 m/s moves by .04 m, as the noise of registration.
_MIN_DISTINCT: Final = 25
# Of all points, more than a quarter turn away: none in recordings of five lidars.
_MAX_ELSEWHERE: Final = 0.0002
# A sweep takes an interval; some lidars pause, and stamps are rounded.
_TOLERANCE: Final = 0.1
# Of the sensor, above which a sweep without times may be distorted by more than .2 m.
_SLOW_M_S: Final = 2.0


class _Times(NamedTuple):
    """Times of one sweep; its duration is that of the whole turn for a lidar that turns."""

    duration_s: float
    span_s: float  # of 98 % of the points
    reach_s: float  # of all
    is_turning: bool
    num_distinct: int
    elsewhere: float  # share of points whose time does not fit their azimuth


class TimesOfPoints(Assumption):
    """Compares the times of points with the interval of stamps and with azimuths."""

    def __init__(self, rotation: LidarRotation) -> None:
        """Starts without clouds; `rotation` is that of the stream."""
        self._rotation = rotation
        self._times: deque[_Times] = deque(maxlen=100)
        self._intervals_s: deque[float] = deque(maxlen=100)
        self._speeds_m_s: deque[float] = deque(maxlen=100)
        self._source, self._fault, self._num_faults, self._num = "none", "", 0, 0
        self._last_ns, self._unused = 0, ""

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        stamp_ns = sample.sweep.stamp_ns
        if self._last_ns and stamp_ns > self._last_ns:
            self._intervals_s.append((stamp_ns - self._last_ns) / 1e9)
        self._last_ns, self._num = stamp_ns, self._num + 1
        if sample.cloud is not None:
            self._source = sample.cloud.times.source
            names = [field.name for field in sample.cloud.message.fields]
            self._unused = next((name for name in names if "time" in name), "")
            if fault := sample.cloud.times.fault:
                self._fault, self._num_faults = fault, self._num_faults + 1
        if sample.is_due and sample.times_s is not None and len(sample.times_s):
            self._times.append(_measured(sample.times_s, sample))

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        if step.interval_s > 0:
            self._speeds_m_s.append(step.way_m / step.interval_s)

    def facts(self) -> dict[str, str]:
        """Times of points, in words."""
        if not self._times:
            how = "a cloud counts as taken in one moment"
            if self._rotation.is_found:
                how = "methods get times by the order of the points, as the lidar turns"
            return {"times of points": f"none: {how}"}
        order = "" if self._is_turning else "not "
        text = f"{self._source}, {1e3 * self._span_s:.1f} ms a sweep, {order}in order of azimuth"
        return {"times of points": text}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._num_faults:
            found = f"times of points cannot be read in {self._num_faults} of {self._num} clouds"
            remedy = "Name field and unit by time.field and time.unit, or time.field=none"
            yield Finding(_ASSUMPTION, Severity.ERROR, f"{found}: {self._fault}", remedy)
        elif not self._times:
            yield from self._without()
        elif self._intervals_s:
            yield from self._contradictions(float(np.median(self._intervals_s)))

    @property
    def _duration_s(self) -> float:
        return float(np.median([one.duration_s for one in self._times]))

    @property
    def _span_s(self) -> float:
        return float(np.median([one.span_s for one in self._times]))

    @property
    def _is_turning(self) -> bool:
        return bool(np.median([one.is_turning for one in self._times]))

    def _without(self) -> Iterator[Finding]:
        if self._rotation.is_found:
            found = "points have no times, but the lidar turns; methods get times by their order"
            remedy = "Publish the time of each point: it holds from the first sweep on"
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)
            return
        speed_m_s = float(np.median(self._speeds_m_s)) if self._speeds_m_s else 0.0
        if speed_m_s > _SLOW_M_S and self._intervals_s:
            shift_m = speed_m_s * float(np.median(self._intervals_s))
            found = (
                f"points have no times, and the sensor moves at {speed_m_s:.1f} m/s: up to "
                f"{shift_m:.1f} m off, if the lidar turns and its driver does not correct it"
            )
            # No value is named: a wrong one, or one for a cloud of one moment, makes flow worse.
            remedy = "If so, publish the time of each point, or say by time.field how it turns"
            if self._unused:
                remedy = f"If the field {self._unused!r} has them, set time.field={self._unused}"
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)

    def _contradictions(self, interval_s: float) -> Iterator[Finding]:
        duration_s = self._duration_s
        span_s = self._span_s
        spans = f"times of points span {1e3 * span_s:.1f} ms"
        text = f"{spans}, sweeps are {1e3 * interval_s:.1f} ms apart"
        remedy = "Correct the driver, set time.unit, or use no times: time.field=none"
        if span_s > (1 + _TOLERANCE) * interval_s:
            yield Finding(_ASSUMPTION, Severity.ERROR, text, remedy)
        elif self._is_turning and duration_s < 1 / _MAX_RATE_HZ and duration_s < interval_s / 2:
            text += f": no lidar turns {1 / duration_s:.0f} times a second"
            yield Finding(_ASSUMPTION, Severity.ERROR, text, remedy)
        reach_s = float(np.median([one.reach_s for one in self._times]))
        if reach_s > 2 * span_s:
            text = f"{spans}, but those of a few points {1e3 * reach_s:.1f} ms"
            yield Finding(_ASSUMPTION, Severity.WARNING, text, remedy)
        if not self._is_turning:
            return
        distinct = int(np.median([one.num_distinct for one in self._times]))
        if span_s < duration_s / 2:
            distinct = int(distinct * duration_s / span_s)
        if distinct < _MIN_DISTINCT:
            text = (
                f"times of points have only {distinct} different values a sweep, "
                f"{1e3 * duration_s / distinct:.0f} ms apart"
            )
            remedy = "Record without a codec that rounds times, or use no times: time.field=none"
            yield Finding(_ASSUMPTION, Severity.WARNING, text, remedy)
        elsewhere = float(np.mean([one.elsewhere for one in self._times]))
        if elsewhere > _MAX_ELSEWHERE:
            text = f"the times of {elsewhere:.2%} of the points contradict their direction"
            remedy = "Look for lost packets, whose points have the time 0"
            yield Finding(_ASSUMPTION, Severity.WARNING, text, remedy)


def _measured(times_s: NDArray[np.float64], sample: SweepSample) -> _Times:
    low, high = np.quantile(times_s, (0.01, 0.99))
    span_s = float(high - low) / 0.98
    turn_s = span_s / float(np.mean(sample.sectors))
    angles = 2 * np.pi * times_s / max(turn_s, 1e-9)
    phases = [np.exp(1j * (angles + sign * sample.azimuths)) for sign in (-1, 1)]
    phase = max(phases, key=lambda one: abs(one.mean()))
    mean = phase.mean()
    is_turning = span_s > 0 and abs(mean) > _TURNING
    elsewhere = np.mean((phase * np.conj(mean)).real < 0) if is_turning else 0.0
    duration_s = turn_s if is_turning else span_s
    reach_s, num_distinct = float(np.ptp(times_s)), len(np.unique(times_s))
    return _Times(duration_s, span_s, reach_s, bool(is_turning), num_distinct, float(elsewhere))
