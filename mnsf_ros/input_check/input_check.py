# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All assumptions about the input, measured on a stream of sweeps."""

import threading
from typing import Final

import numpy as np

from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.cloud_layout import CloudLayout
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.imu_fit import ImuFit
from mnsf_ros.input_check.level_frame import LevelFrame
from mnsf_ros.input_check.odometry_fit import OdometryFit
from mnsf_ros.input_check.point_times import TimesOfPoints
from mnsf_ros.input_check.revolution import Revolution
from mnsf_ros.input_check.robot_in_view import RobotInView
from mnsf_ros.input_check.stamps import Stamps
from mnsf_ros.input_check.sweep_sample import Located, Step, SweepSample
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import Sweep

# One cloud of so many is looked at: what is wrong with it is wrong with most, and it costs 2 ms.
_EVERY: Final = 8


class InputCheck:
    """Measures what the method assumes about its input. Any thread may call it.

    It keeps two sweeps and some hundred numbers.

    Attributes:
        num_clouds: Clouds that were added.
    """

    def __init__(
        self, settings: Settings, mounting: MountingEstimate, rotation: LidarRotation
    ) -> None:
        """Starts without clouds.

        Args:
            settings: Those of the stream.
            mounting: That of the stream.
            rotation: That of the stream.
        """
        self.num_clouds = 0
        self._mounting = mounting
        self._lock = threading.Lock()
        self._assumptions: tuple[Assumption, ...] = (
            CloudLayout(),
            Revolution(),
            Stamps(),
            TimesOfPoints(rotation),
            LevelFrame(mounting),
            RobotInView(is_searched=settings.crop.own_body == "auto"),
        )
        self._by_registration: tuple[Assumption, ...] = (OdometryFit(settings.ego_motion), ImuFit())
        self._all: tuple[Assumption, ...] = (*self._assumptions, *self._by_registration)
        self._last: Located | None = None

    def add(self, cloud: Sweep, num_parts: int = 1) -> None:
        """Takes the next cloud, with a CloudSource as `source`; of a revolution or a part."""
        with self._lock:
            self.num_clouds += 1
            found = self._mounting.found
            lens_m = np.zeros(3) if found is None else found.lens_m
            sample = SweepSample(cloud, self.num_clouds % _EVERY == 1, num_parts, lens_m)
            for assumption in self._all:
                assumption.add(sample)

    def locate(self, located: Located | None) -> None:
        """Takes the pose of the next sweep, if that is known."""
        with self._lock:
            last, self._last = self._last, located or self._last
            if last is not None and located is not None:
                step = Step(last, located)
                if step.is_possible:
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
