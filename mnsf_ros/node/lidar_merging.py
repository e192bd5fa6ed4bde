# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds of several lidars as one sweep in a common frame."""

from __future__ import annotations

import time
from collections.abc import Container, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from mnsf_ros.geometry.transforms import mounted_at
from mnsf_ros.node.subscriptions import Report
from mnsf_ros.node.transforms import TransformError, Transforms
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.lidar_groups import ArrivedSweep, LidarGroup, LidarGroups
from mnsf_ros.sweeps.sweep import NANOSECONDS
from mnsf_ros.sweeps_io.merged_cloud import merged_sweep


@dataclass
class LidarMerging:
    """Groups sweeps by their time, and merges those whose lidar has a known pose.

    Attributes:
        topics: Topics of the lidars, in their order.
        report: Counts and logs lidars that are left out.
        missing: Topics of the lidars that are not in the last merged sweep.
    """

    topics: tuple[str, ...]
    report: Report
    missing: tuple[str, ...] = ()
    _groups: LidarGroups = field(init=False)

    def __post_init__(self) -> None:
        """Starts without a sweep."""
        self._groups = LidarGroups(len(self.topics))

    @property
    def is_waiting(self) -> bool:
        """Whether a sweep is incomplete but may become due."""
        return self._groups.is_waiting

    def clear(self) -> None:
        """Forgets all sweeps."""
        self._groups.clear()

    def add(self, index: int, item: ArrivedSweep, settings: Settings) -> None:
        """Takes the sweep of a lidar."""
        self._groups.add(index, item, settings.lidars)

    def due(self, settings: Settings, transforms: Transforms | None) -> Iterator[ArrivedSweep]:
        """Yields merged sweeps, with the arrival of the reference lidar's sweep."""
        for group in self._groups.due(time.monotonic(), settings.lidars):
            poses = self._poses(group, settings, transforms)
            self._tell_missing(group, poses)
            if poses:
                sweeps = {index: group.sweeps[index].sweep for index in poses}
                stamp_ns = group.reference.sweep.stamp_ns
                header = Header(frame_id=settings.lidars.frame)
                header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
                sweep = merged_sweep(sweeps, poses, stamp_ns, header)
                yield ArrivedSweep(sweep, group.reference.arrived_ns)

    def _poses(
        self, group: LidarGroup, settings: Settings, transforms: Transforms | None
    ) -> dict[int, NDArray[np.float64]]:
        """Number of a lidar -> its pose (4, 4) in the common frame, where that is known."""
        if transforms is None:
            mounts = (settings.lidar_1, settings.lidar_2, settings.lidar_3, settings.lidar_4)
            return {index: mounted_at(mounts[index]) for index in group.sweeps}
        poses = {}
        for index, item in group.sweeps.items():
            try:
                poses[index] = transforms.find(settings.lidars.frame, item.sweep.frame_id)
            except TransformError as error:
                self.report(
                    f"clouds_of_lidar_{index + 1}_without_transform", f"{error}; it is left out"
                )
        return poses

    def _tell_missing(self, group: LidarGroup, merged: Container[int]) -> None:
        self.missing = tuple(
            topic for index, topic in enumerate(self.topics) if index not in merged
        )
        for index, topic in enumerate(self.topics):
            if index not in group.sweeps:
                text = (
                    f"no cloud of {topic} is near in time: merged without it (see "
                    "lidars.tolerance_s, lidars.max_wait_s)"
                )
                self.report(f"clouds_of_lidar_{index + 1}_missing", text)
