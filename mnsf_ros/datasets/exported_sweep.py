# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps with an estimate of their flow, for files of other projects."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats, Floats32
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.geometry.rigid_motion import residual_flow, rigid_flow
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, FlowTruth, SurfaceClass
from mnsf_ros.sweeps.sweep import Sweep


@dataclass(frozen=True, eq=False)
class ExportedSweep:
    """A recorded sweep of N measured points, and their flow until the next sweep, with ego motion.

    Without a next sweep `next_from_current` is None, and there is no flow.
    """

    sweep: Sweep  # its `source` has the rows of its points in the recorded cloud
    ground: Bools  # (N,)
    pose: Floats  # (4, 4) world_from_sensor
    next_from_current: Floats | None = None  # (4, 4) motion of static points
    interval_s: float = 0.0  # until the next sweep
    estimate: FlowEstimate | None = None  # row for row; None if the method has none
    truth: FlowTruth | None = None  # row for row; None if unknown

    @property
    def flow(self) -> Floats32:
        """(N, 3) metres; points without an estimate move as static ones."""
        ego_flow = rigid_flow(self.sweep.xyz, self._motion)
        if self.estimate is None:
            return ego_flow
        return np.where(self.is_estimated[:, None], self.estimate.flow, ego_flow)

    @property
    def is_estimated(self) -> Bools:
        """(N,) the points with an estimate."""
        if self.estimate is None:
            return np.zeros(len(self.sweep), dtype=bool)
        return np.asarray(np.isfinite(self.estimate.flow).all(axis=1))

    @property
    def dynamic(self) -> Bools:
        """(N,) the points that move over ground, by the method if it finds movers, else by flow."""
        if self.estimate is not None and self.estimate.over_ground is not None:
            return self.estimate.over_ground.dynamic
        return np.linalg.norm(self.residual, axis=1) > DYNAMIC_SPEED_M_S * self.interval_s

    @property
    def residual(self) -> Floats32:
        """(N, 3) metres, flow without ego motion, in the axes of the next sweep."""
        return residual_flow(self.sweep.xyz, self.flow, self._motion)

    @property
    def as_truth(self) -> FlowTruth:
        """The estimate as truth: dynamic points are cars, objects have the numbers of tracks."""
        known = None if self.estimate is None else self.estimate.over_ground
        track_ids = None if known is None else known.track_ids
        if track_ids is None:
            track_ids = np.zeros(len(self.sweep), dtype=np.int32)
        return FlowTruth(
            stamp_ns=self.sweep.stamp_ns,
            flow=self.flow,
            valid=self.is_estimated,
            dynamic=self.dynamic,
            ground=self.ground,
            class_id=np.where(self.dynamic, SurfaceClass.CAR, 0).astype(np.uint8),
            object_id=track_ids.astype(np.uint32),
        )

    @property
    def _motion(self) -> Floats:
        return np.eye(4) if self.next_from_current is None else self.next_from_current

    def in_rows(self, values: NDArray[Any]) -> NDArray[Any]:
        """Returns values (N, ...) of the points in the rows of the recorded cloud, 0 elsewhere."""
        cloud = self.sweep.source
        result = np.zeros((cloud.num_points, *values.shape[1:]), dtype=values.dtype)
        result[cloud.rows] = values
        return result
