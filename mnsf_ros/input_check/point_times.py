# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: each point has the time of its measurement, or all have the same."""

from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.new_points import NewPoints
from mnsf_ros.input_check.sweep_sample import Step, SweepSample
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes, Turn

_ASSUMPTION: Final = "each point has its time of measurement"
# Lidars turn at 5 to 20 Hz, a few at 30.
_MAX_RATE_HZ: Final = 35.0
# Of a turn. In 1/25 of .1 s a sensor of 10 m/s moves by .04 m, as the noise of registration.
_MIN_DISTINCT: Final = 25
# A sweep takes an interval; some lidars pause, and stamps are rounded.
_TOLERANCE: Final = 0.1
# Of the sensor, above which a sweep without times may be distorted by more than .2 m.
_SLOW_M_S: Final = 2.0


class _Times(NamedTuple):
    """Times of one sweep."""

    span_s: float  # of 98 % of the points
    reach_s: float  # of all
    num_distinct: int
    turn: Turn | None
    by_azimuth: AzimuthTimes | None  # times that are right, if the lens is the origin

    @property
    def duration_s(self) -> float:
        """Of the whole turn for a lidar that turns."""
        return self.span_s if self.turn is None else self.turn.duration_s


class TimesOfPoints(Assumption):
    """Compares the times of points with the interval of stamps and with azimuths."""

    def __init__(self, rotation: LidarRotation, new_points: NewPoints) -> None:
        """Starts without clouds; `rotation` is that of the stream."""
        self._new_points = new_points
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
        text = f"{self._source}, {1e3 * self._span_s:.1f} ms a cloud, {order}in order of azimuth"
        return {"times of points": text}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._num_faults:
            found = f"times of points cannot be read in {self._num_faults} of {self._num} clouds"
            remedy = "Set time.field and time.unit to the right field and unit, or time.field=none"
            yield Finding(_ASSUMPTION, Severity.ERROR, f"{found}: {self._fault}", remedy)
        elif not self._times:
            yield from self._without()
        # The times of several sweeps in a cloud are right; without them it would be worse.
        elif self._intervals_s and self._new_points.num_sweeps == 1:
            yield from self._contradictions(float(np.median(self._intervals_s)))

    @property
    def _duration_s(self) -> float:
        return float(np.median([one.duration_s for one in self._times]))

    @property
    def _span_s(self) -> float:
        return float(np.median([one.span_s for one in self._times]))

    @property
    def _is_turning(self) -> bool:
        return bool(np.median([one.turn is not None for one in self._times]))

    def _without(self) -> Iterator[Finding]:
        if self._rotation.is_found:
            found = "points have no times, but the lidar turns; methods get times by their order"
            remedy = "Nothing needs doing; published times would hold from the first sweep on"
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)
            return
        speed_m_s = float(np.median(self._speeds_m_s)) if self._speeds_m_s else 0.0
        if speed_m_s > _SLOW_M_S and self._intervals_s:
            shift_m = speed_m_s * float(np.median(self._intervals_s))
            found = (
                f"points have no times, and the sensor moves at {speed_m_s:.1f} m/s: they are "
                f"up to {shift_m:.1f} m off, if the lidar turns and its driver does not correct it"
            )
            # No value is named: a wrong one, or one for a cloud of one moment, makes flow worse.
            remedy = "If so, let the driver publish the time of each point; otherwise do nothing"
            if self._unused:
                remedy = (
                    f"If so, and field {self._unused!r} has them, set time.field={self._unused}"
                )
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)

    def _contradictions(self, interval_s: float) -> Iterator[Finding]:
        duration_s = self._duration_s
        span_s = self._span_s
        spans = f"times of points span {1e3 * span_s:.1f} ms"
        text = f"{spans}, sweeps are {1e3 * interval_s:.1f} ms apart"
        remedy = "Use no times: set time.field=none"
        if by_azimuth := self._times[-1].by_azimuth:
            remedy = f"Take the times from the azimuth: set time.field={by_azimuth}"
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
                f"{1e3 * duration_s / max(distinct - 1, 1):.0f} ms apart"
            )
            yield Finding(_ASSUMPTION, Severity.WARNING, text, remedy)


def _measured(times_s: Floats, sample: SweepSample) -> _Times:
    low_s, high_s = np.quantile(times_s, (0.01, 0.99))
    turn, by_azimuth = sample.turn, None
    if turn is not None and not sample.lens_m.any():
        by_azimuth = turn.by_azimuth(float(times_s.min() + times_s.max()) / 2)
    return _Times(
        float(high_s - low_s) / 0.98,
        float(np.ptp(times_s)),
        len(np.unique(times_s)),
        turn,
        by_azimuth,
    )
