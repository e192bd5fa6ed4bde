# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""All assumptions about the input, measured on a stream of sweeps."""

import threading
from typing import Final

import numpy as np

from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.clear_view import ClearView
from mnsf_ros.input_check.close_clouds import CloseClouds
from mnsf_ros.input_check.cloud_layout import CloudLayout
from mnsf_ros.input_check.computer_clock import ComputerClock
from mnsf_ros.input_check.episodes import LIVE_MEMORY
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.fresh_clouds import FreshClouds
from mnsf_ros.input_check.imu_fit import ImuFit
from mnsf_ros.input_check.imu_goes_on import ImuGoesOn
from mnsf_ros.input_check.level_frame import LevelFrame
from mnsf_ros.input_check.metres import Metres
from mnsf_ros.input_check.new_points import NewPoints
from mnsf_ros.input_check.odometry_fit import OdometryFit
from mnsf_ros.input_check.one_lidar import OneLidar
from mnsf_ros.input_check.point_times import TimesOfPoints
from mnsf_ros.input_check.revolution import Revolution
from mnsf_ros.input_check.robot_in_view import RobotInView
from mnsf_ros.input_check.stamps import Stamps
from mnsf_ros.input_check.steady_axes import SteadyAxes
from mnsf_ros.input_check.steady_scale import SteadyScale
from mnsf_ros.input_check.sweep_sample import MAX_STEP_S, Located, Step, SweepSample
from mnsf_ros.input_check.whole_view import WholeView
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# One cloud of so many is looked at: what is wrong with it is wrong with most, and it costs 2 ms.
_EVERY: Final = 8


class InputCheck:
    """Measures what the method assumes about its input. Any thread may call it.

    It keeps two sweeps and some hundred numbers.

    Attributes:
        num_clouds: Clouds that were added.
    """

    def __init__(
        self,
        settings: Settings,
        mounting: MountingEstimate,
        rotation: LidarRotation,
        *,
        is_live: bool = False,
    ) -> None:
        """Starts without clouds.

        Args:
            settings: Those of the stream.
            mounting: That of the stream.
            rotation: That of the stream.
            is_live: Whether the clouds come from a lidar now: what passed is told for a while only.
        """
        self.num_clouds = 0
        memory = LIVE_MEMORY if is_live else np.inf
        self._clock = ComputerClock(is_live=is_live)
        self._last_cloud = ("", 0)  # frame and stamp
        self._mounting = mounting
        self._lock = threading.Lock()
        new_points = NewPoints()
        self._assumptions: tuple[Assumption, ...] = (
            FreshClouds(memory),
            WholeView(memory),
            new_points,
            OneLidar(),
            Metres(),
            SteadyScale(memory),
            SteadyAxes(memory),
            CloudLayout(),
            Revolution(),
            CloseClouds(settings.buffer),
            Stamps(),
            TimesOfPoints(rotation, new_points),
            LevelFrame(mounting),
            RobotInView(is_searched=settings.crop.own_body == "auto"),
            self._clock,
            ClearView(memory),
            ImuGoesOn(memory),
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
            is_due, is_continued = self.num_clouds % _EVERY == 1, self._continues(cloud)
            sample = SweepSample(cloud, is_due, num_parts, lens_m, is_continued)
            for assumption in self._all:
                assumption.add(sample)

    def _continues(self, cloud: Sweep) -> bool:
        """Whether the last cloud was taken from nearly the same place."""
        (frame_id, last_ns), now_ns = self._last_cloud, cloud.stamp_ns
        self._last_cloud = cloud.frame_id, now_ns
        return frame_id == cloud.frame_id and 0 < now_ns - last_ns < MAX_STEP_S * NANOSECONDS

    @property
    def is_alarm(self) -> bool:
        """Whether something stopped to hold just now, which should be told at once."""
        with self._lock:
            return any(one.is_alarm for one in self._assumptions)

    @property
    def is_played(self) -> bool:
        """Whether the clouds come from a program that plays recordings; it can be set."""
        return self._clock.is_played

    @is_played.setter
    def is_played(self, is_played: bool) -> None:
        self._clock.is_played = is_played

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
