# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps with an estimate of their flow, for files of other projects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.geometry.rigid_motion import residual_flow, rigid_flow
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, FlowTruth


@dataclass(frozen=True, eq=False)
class ExportedFlow:
    """Flow of N points until the next sweep, with ego motion: that of static points by default.

    Attributes:
        xyz: (N, 3) float32 metres, sensor frame.
        next_from_current: (4, 4) motion of static points between the two sensor frames.
        interval_s: Seconds until the next sweep.
        estimate: The estimate, row for row; None if the method has none for this sweep.
        truth: True flow, row for row; None if unknown.
    """

    xyz: NDArray[np.float32]
    next_from_current: NDArray[np.float64]
    interval_s: float
    estimate: FlowEstimate | None = None
    truth: FlowTruth | None = None

    @property
    def flow(self) -> NDArray[np.float32]:
        """(N, 3) metres; where there is no estimate, that of static points."""
        ego_flow = rigid_flow(self.xyz, self.next_from_current)
        if self.estimate is None:
            return ego_flow
        return np.where(self.is_estimated[:, None], self.estimate.flow, ego_flow)

    @property
    def is_estimated(self) -> NDArray[np.bool_]:
        """(N,) the points with an estimate."""
        if self.estimate is None:
            return np.zeros(len(self.xyz), dtype=bool)
        return np.asarray(np.isfinite(self.estimate.flow).all(axis=1))

    @property
    def dynamic(self) -> NDArray[np.bool_]:
        """(N,) the points that move over ground, as the method says, or by their flow."""
        if self.estimate is not None and self.estimate.over_ground is not None:
            return self.estimate.over_ground.dynamic
        residual = residual_flow(self.xyz, self.flow, self.next_from_current)
        limit_m = DYNAMIC_SPEED_M_S * self.interval_s
        moves: NDArray[np.bool_] = np.linalg.norm(residual, axis=1) > limit_m
        return moves

    @property
    def track_ids(self) -> NDArray[np.int32]:
        """(N,) number of the tracked object of each point, 0 for none."""
        known = None if self.estimate is None else self.estimate.over_ground
        if known is None or known.track_ids is None:
            return np.zeros(len(self.xyz), dtype=np.int32)
        return known.track_ids


@dataclass(frozen=True, eq=False)
class ExportedSweep:
    """The N finite points of a recorded sweep.

    Attributes:
        stamp_ns: Header stamp in nanoseconds.
        xyz: (N, 3) float32 metres, sensor frame.
        rows: (N,) their rows in the recorded cloud.
        num_rows: Rows of that cloud.
        ground: (N,) bool, the points on the ground.
        pose: (4, 4) `world_from_sensor`.
        motion: Their flow; None without a next sweep.
    """

    stamp_ns: int
    xyz: NDArray[np.float32]
    rows: NDArray[np.int64]
    num_rows: int
    ground: NDArray[np.bool_]
    pose: NDArray[np.float64]
    motion: ExportedFlow | None = None

    def in_rows(self, values: NDArray[Any]) -> NDArray[Any]:
        """Returns values (N, ...) of the points in the rows of the recorded cloud, 0 elsewhere."""
        result = np.zeros((self.num_rows, *values.shape[1:]), dtype=values.dtype)
        result[self.rows] = values
        return result
