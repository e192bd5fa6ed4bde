# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of the last estimate, moved on: where the next one starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.methods.neural.parts import Parts
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.point_grid import PointGrid
from mnsf_ros.sweeps.sweep import NANOSECONDS

_REACH_M: Final = 0.5
# A part is expected to move if more than this share of its points is where moving ones went.
_MIN_SHARE: Final = 0.3
_MAX_AGE_S: Final = 0.5


@dataclass(frozen=True, eq=False)
class CarriedFlow:
    """Points that moved in a sweep, in the world.

    Attributes:
        stamp_ns: Stamp of the sweep.
        places: (P, 3) float32, metres.
        velocities: (P, 3) float32, metres per second.
    """

    stamp_ns: int
    places: NDArray[np.float32]
    velocities: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        current: ObjectSweep,
        positions: NDArray[np.float32],
        flow: NDArray[np.float32],
        interval_s: float,
    ) -> CarriedFlow:
        """Takes the flow (P, 3), metres in an interval, at positions (P, 3) of a sweep."""
        pose = current.pose.world_from_sensor
        velocities = turned(flow, pose[:3, :3]) / np.float32(interval_s)
        return cls(current.sweep.stamp_ns, transformed(positions, pose), velocities)

    def expected(
        self, current: ObjectSweep, parts: Parts, interval_s: float
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Returns what is expected of the parts of a later sweep.

        Returns:
            (K, 3) metres to the next sweep, 0 if nothing is known, and (K,) whether they are
            expected to move.
        """
        age_s = (current.sweep.stamp_ns - self.stamp_ns) / NANOSECONDS
        if len(self.places) == 0 or not 0 < age_s <= _MAX_AGE_S:
            return nothing_expected(parts)
        sensor_from_world = np.asarray(np.linalg.inv(current.pose.world_from_sensor), np.float64)
        moved = self.places + np.float32(age_s) * self.velocities
        grid = PointGrid(transformed(moved, sensor_from_world))
        nearest = grid.nearest(parts.positions, _REACH_M)
        flow = turned(self.velocities, sensor_from_world[:3, :3])[nearest] * np.float32(interval_s)
        flow[nearest < 0] = 0
        shares = parts.means(nearest >= 0)
        motions = parts.means(flow) / np.maximum(shares, 1e-6)[:, None]
        return motions.astype(np.float32), shares > _MIN_SHARE


def nothing_expected(parts: Parts) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Returns the same for parts of which nothing is known."""
    return np.zeros((len(parts), 3), np.float32), np.zeros(len(parts), np.bool_)
