# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reference rows for every table: zero flow, and the flow of a static world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.ego_motion.ego_motion import SensorPoses
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet


class _Reference:
    """A method that fits nothing to the sweeps."""

    traits = MethodTraits(is_reference=True)
    _stage: str

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def with_settings(self, settings: Settings) -> _Reference:
        """Returns the same with other settings."""
        return type(self)(settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Returns the flow of all points of the current sweep.

        Raises:
            SweepError: The ego motion is needed and not known.
        """
        clock = StageClock()
        with clock.stage(self._stage):
            flow = self._flow(triplet)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)

    def _flow(self, triplet: SweepTriplet) -> NDArray[np.float32]:
        raise NotImplementedError


class ZeroEstimator(_Reference):
    """Returns zero flow: no point moves in the sensor frame."""

    _stage = "zero"

    def _flow(self, triplet: SweepTriplet) -> NDArray[np.float32]:
        return np.zeros_like(triplet.current.xyz)


class EgoMotionEstimator(_Reference):
    """Returns the flow of a static world, from the ego motion of the recording."""

    traits = MethodTraits(needs_poses=True, is_reference=True)
    _stage = "rigid"

    def _flow(self, triplet: SweepTriplet) -> NDArray[np.float32]:
        if triplet.next_from_current is None:
            raise SweepError(
                f"sweep {triplet.current.stamp_ns}: the ego motion is not known, expected "
                "next_from_current; does the recording have odometry?"
            )
        return rigid_flow(triplet.current.xyz, triplet.next_from_current)


class EstimatedEgoMotionEstimator(_Reference):
    """Returns the flow of a static world, from the ego motion that `online` estimates.

    In most recordings the ego motion of `ego` is the ground truth itself.
    """

    traits = MethodTraits(carries_state=True, is_reference=True)
    _stage = "ego motion"

    def __init__(self, settings: Settings) -> None:
        """Makes a new estimator."""
        super().__init__(settings)
        self.traits = replace(self.traits, max_gap_s=settings.ego_motion.max_gap_s)
        self._poses = SensorPoses(settings.ego_motion)

    def with_settings(self, settings: Settings) -> EstimatedEgoMotionEstimator:
        """Returns the same with other settings; it keeps the poses if they are still valid."""
        other = EstimatedEgoMotionEstimator(settings)
        if settings.ego_motion == self.settings.ego_motion:
            other._poses = self._poses
        return other

    def _flow(self, triplet: SweepTriplet) -> NDArray[np.float32]:
        poses = self._poses.of(triplet.sweeps, triplet.stretch)
        current, following = (
            poses[sweep].world_from_sensor for sweep in (triplet.current, triplet.next)
        )
        return rigid_flow(triplet.current.xyz, np.linalg.inv(following) @ current)
