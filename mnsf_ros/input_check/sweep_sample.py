# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Some points of a sweep, which all assumptions share: the check must cost little."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.input_check.glance import Glance
from mnsf_ros.sweeps.azimuth_times import Turn
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# A share of 1 % is known to .2 % from one sweep.
_NUM_POINTS: Final = 2048
RUN: Final = 8  # neighbours, which are in the same line of the cache
NUM_SECTORS: Final = 72
MAX_STEP_S: Final = 1.0
_MAX_STEP_M: Final = 10.0


@dataclass(frozen=True, eq=False)
class SweepSample:
    """Random points of a sweep, without exact zeros.

    Attributes:
        sweep: The sweep, with a CloudSource as `source`, or without one.
        is_due: Whether to look at its points; some sweeps tell enough.
        num_parts: Clouds of its revolution.
        lens_m: (3,) metres, the lens in the frame of the cloud, as far as it is known.
        is_continued: Whether it follows the cloud before it, without a gap.
    """

    sweep: Sweep
    is_due: bool = True
    num_parts: int = 1
    lens_m: Floats = field(default_factory=lambda: np.zeros(3))
    is_continued: bool = True

    @cached_property
    def glance(self) -> Glance | None:
        """A look at fewer points, for what is watched in each cloud; None without points."""
        return Glance.of(self.sweep, self.lens_m)

    @cached_property
    def rows(self) -> Ints:
        """(K,) numbers of the points."""
        number = len(self.sweep)
        rows = np.arange(number)
        if number > _NUM_POINTS:
            starts = np.random.default_rng(number).integers(0, number - RUN, _NUM_POINTS // RUN)
            rows = (np.sort(starts)[:, None] + np.arange(RUN)).ravel()
        return rows[self.sweep.xyz[rows].any(axis=1)]

    @cached_property
    def xyz(self) -> Floats:
        """(K, 3) metres, from the lens, axes of the cloud."""
        return self.sweep.xyz[self.rows] - self.lens_m

    @property
    def cloud(self) -> Any:  # noqa: ANN401 - a CloudSource
        """Source of the sweep; None for sweeps of arrays."""
        return self.sweep.source

    @cached_property
    def azimuths(self) -> Floats:
        """(K,) radians, from -pi to pi."""
        return np.arctan2(self.xyz[:, 1], self.xyz[:, 0])

    @cached_property
    def elevations(self) -> Floats:
        """(K,) radians above the plane z = 0."""
        return np.arctan2(self.xyz[:, 2], np.hypot(self.xyz[:, 0], self.xyz[:, 1]))

    @cached_property
    def sectors(self) -> Bools:
        """(72,) the sectors of 5 degrees that have a point."""
        cells = ((self.azimuths + np.pi) / (2 * np.pi) * NUM_SECTORS).astype(np.int64)
        return np.bincount(cells % NUM_SECTORS, minlength=NUM_SECTORS) > 0

    @cached_property
    def times_s(self) -> Floats | None:
        """(K,) seconds from the stamp; None if unknown."""
        times_s = self.sweep.times_s
        return None if times_s is None else times_s[self.rows].astype(np.float64)

    @cached_property
    def turn(self) -> Turn | None:
        """Rotation of the lidar by the times of points; None if unknown, or if it does not turn."""
        times_s = self.times_s
        return None if times_s is None else Turn.of(self.azimuths / (2 * np.pi), times_s)


@dataclass(frozen=True, eq=False)
class Located:
    """A sweep and where it was taken.

    Attributes:
        sweep: All of it, with `odometry` if known.
        world_from_sensor: (4, 4) float64, at its stamp.
        source: The EgoSource of the pose.
        own_body: (B, 3) float32, metres, points on the robot's own body.
    """

    sweep: Sweep
    world_from_sensor: Floats
    source: str
    own_body: Floats32 = field(default_factory=lambda: np.zeros((0, 3), np.float32))

    @classmethod
    def by(cls, estimate: FlowEstimate, sweep: Sweep) -> "Located | None":
        """Returns it as known by the estimate of the sweep; None if that has no pose."""
        if (known := estimate.over_ground) is None:
            return None
        return cls(sweep, known.world_from_sensor, known.source, estimate.own_body)


@dataclass(frozen=True, eq=False)
class Step:
    """Motion of the sensor between two consecutive sweeps."""

    before: Located
    after: Located

    @cached_property
    def before_from_after(self) -> Floats:
        """(4, 4) float64."""
        return np.linalg.inv(self.before.world_from_sensor) @ self.after.world_from_sensor

    @property
    def is_possible(self) -> bool:
        """False at a gap, and into another world."""
        return 0 < self.interval_s < MAX_STEP_S and self.way_m < _MAX_STEP_M

    @property
    def way_m(self) -> float:
        """Metres travelled."""
        return float(np.linalg.norm(self.before_from_after[:3, 3]))

    @property
    def interval_s(self) -> float:
        """Seconds between the stamps."""
        return (self.after.sweep.stamp_ns - self.before.sweep.stamp_ns) / NANOSECONDS
