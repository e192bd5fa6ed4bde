# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All assumptions about the input, measured on a stream of sweeps."""

import threading
from collections.abc import Iterator
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.input_check.cloud_layout import CloudLayout
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.imu_fit import ImuFit
from mnsf_ros.input_check.mounting import Mounting
from mnsf_ros.input_check.no_returns import NoReturns
from mnsf_ros.input_check.odometry_fit import OdometryFit
from mnsf_ros.input_check.own_body import OwnBody
from mnsf_ros.input_check.point_times import TimesOfPoints
from mnsf_ros.input_check.revolution import Revolution
from mnsf_ros.input_check.stamps import Stamps
from mnsf_ros.input_check.sweep_sample import Located, Step, SweepSample
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep

# Sweeps that may wait for their pose.
_MAX_WAITING: Final = 12


class Assumption(Protocol):
    """Measures one assumption."""

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""

    def move(self, step: Step) -> None:
        """Takes the motion between two sweeps, after both."""

    def facts(self) -> dict[str, str]:
        """Name to what was measured, in words."""
        ...

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        ...


class InputCheck:
    """Measures what the method assumes about its input. Any thread may call it.

    It keeps one sweep, some points of a dozen, and some hundred numbers.

    Attributes:
        num_sweeps: Sweeps that were added.
    """

    def __init__(self, settings: Settings) -> None:
        self.num_sweeps = 0
        self._lock = threading.Lock()
        mounting = Mounting(settings)
        self._assumptions: tuple[Assumption, ...] = (
            CloudLayout(),
            Revolution(),
            Stamps(),
            TimesOfPoints(),
            NoReturns(),
            mounting,
            OwnBody(mounting, settings.crop.min_range_m),
        )
        self._by_registration: tuple[Assumption, ...] = (OdometryFit(settings.ego_motion), ImuFit())
        self._all: tuple[Assumption, ...] = (*self._assumptions, *self._by_registration)
        self._waiting: dict[int, NDArray[np.float64]] = {}
        self._last: Located | None = None

    def add(self, sweep: Sweep) -> None:
        """Takes the next sweep, with the CloudSource of its message as `source`."""
        with self._lock:
            self.num_sweeps += 1
            sample = SweepSample.of(sweep)
            self._waiting[sweep.stamp_ns] = sample.xyz
            for stamp_ns in list(self._waiting)[:-_MAX_WAITING]:
                del self._waiting[stamp_ns]
            for assumption in self._all:
                assumption.add(sample)

    def locate(self, sweep: Sweep, world_from_sensor: NDArray[np.float64], source: str) -> None:
        """Takes the pose (4, 4) of a sweep that was added, and its EgoSource.

        The sweep may have been copied since, to add its `odometry`.
        """
        with self._lock:
            if (xyz := self._waiting.get(sweep.stamp_ns)) is None:
                return
            own = Located(sweep, xyz, world_from_sensor, source)
            last, self._last = self._last, own
            if last is not None and (step := Step(last, own)).is_possible:
                for assumption in self._all:
                    assumption.move(step)

    def facts(self) -> dict[str, str]:
        """Name to what the input is, in words."""
        with self._lock:
            return {k: v for one in self._all for k, v in one.facts().items()}

    def findings(self) -> list[Finding]:
        """What does not hold, the worst first.

        Odometry and IMU are judged by registration, which other errors spoil: they come first.
        """
        with self._lock:
            found = [finding for one in self._assumptions for finding in one.findings()]
            if not any(finding.severity is Severity.ERROR for finding in found):
                found += [finding for one in self._by_registration for finding in one.findings()]
        return sorted(found, key=lambda finding: -finding.severity)
