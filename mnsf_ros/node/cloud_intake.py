# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""From received clouds to sweeps, and what is said of clouds that are none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from sensor_msgs.msg import PointCloud2

from mnsf_ros.online.watches import CLOUDS_EMPTY, CLOUDS_UNDECODABLE
from mnsf_ros.settings import TimeSettings
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import sweep_from_message
from msg_utils.errors import MessageError
from msg_utils.point_times import PointTimes

# Takes an event that is counted, and a text that is logged now and then.
Report: TypeAlias = Callable[[str, str], None]


class CloudIntake:
    """Decodes clouds; a bad one is reported and costs nothing else.

    Attributes:
        times_source: What the times of points were read from last.
    """

    def __init__(
        self,
        logger: Any,  # noqa: ANN401 - rclpy's logger type moves about
        report: Report,
        now_ns: Callable[[], int],
    ) -> None:
        """`now_ns` gives the time for clouds that have none."""
        self.times_source = ""
        self._logger = logger
        self._report = report
        self._now_ns = now_ns
        self._told_times: set[str] = set()

    def sweep(self, message: PointCloud2, settings: TimeSettings) -> Sweep | None:
        """Returns the sweep of a cloud; None if it cannot be decoded or has no points."""
        try:
            sweep = sweep_from_message(message, settings, self._now_ns())
        except MessageError as error:
            self._report(CLOUDS_UNDECODABLE, f"a cloud cannot be decoded: {error}")
            return None
        if not sweep.source.is_stamped:
            text = "a cloud has no stamp; its time of arrival is used"
            self._report("clouds_without_stamp", text)
        if len(sweep) == 0:
            self._report(CLOUDS_EMPTY, "a cloud without a finite point is skipped")
            return None
        self._tell_times(sweep.source.times)
        return sweep

    def _tell_times(self, times: PointTimes) -> None:
        if times.fault:
            text = f"the times of points are not used: {times.fault}"
            self._report("clouds_without_usable_times", text)
        self.times_source = times.source
        if times.source not in self._told_times:
            self._told_times.add(times.source)
            self._logger.info(f"time of each point: {times.source}")
