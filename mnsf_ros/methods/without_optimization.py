"""Reference rows for every table: zero flow, and the flow of a static world."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from mnsf_ros.core.compute_device import limit_threads
from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.ego_motion.ego_motion import TripletPoses
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_CPU = torch.device("cpu")


class ZeroEstimator:
    """Returns zero flow: no point moves in the sensor frame."""

    traits = MethodTraits(is_reference=True)

    def __init__(self, settings: Settings) -> None:
        """Takes settings like every method, and needs none."""
        self.settings = settings

    def with_settings(self, settings: Settings) -> ZeroEstimator:
        """Returns the same with other settings."""
        return ZeroEstimator(settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Returns zero flow."""
        clock = StageClock(_CPU)
        with clock.stage("zero"):
            flow = np.zeros_like(triplet.current.xyz)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)


class EgoMotionEstimator:
    """Returns the flow of a static world, by the ego motion that the triplet has."""

    traits = MethodTraits(needs_poses=True, is_reference=True)

    def __init__(self, settings: Settings) -> None:
        """Takes settings like every method, and needs none."""
        self.settings = settings

    def with_settings(self, settings: Settings) -> EgoMotionEstimator:
        """Returns the same with other settings."""
        return EgoMotionEstimator(settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Returns the flow of static points from `triplet.next_from_current`.

        Raises:
            SweepError: If the triplet has no ego motion, or it is not a (4, 4) rigid transform.
        """
        if triplet.next_from_current is None:
            raise SweepError(
                f"sweep {triplet.current.stamp_ns}: the ego motion is not known, expected "
                "next_from_current; does the recording have odometry?"
            )
        clock = StageClock(_CPU)
        with clock.stage("rigid"):
            flow = rigid_flow(triplet.current.xyz, triplet.next_from_current)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)


class EstimatedEgoMotionEstimator:
    """Returns the flow of a static world, by the ego motion that the method `online` finds.

    The motion of `ego` is that of the recording, which is mostly that of its ground truth, too.
    """

    traits = MethodTraits(carries_state=True, is_reference=True)

    def __init__(self, settings: Settings) -> None:
        """Makes an estimator that has seen nothing yet."""
        self.settings = settings
        self._poses = TripletPoses(settings.ego_motion)

    def with_settings(self, settings: Settings) -> EstimatedEgoMotionEstimator:
        """Returns the same with other settings; it keeps the poses if they are still valid."""
        other = EstimatedEgoMotionEstimator(settings)
        if settings.ego_motion == self.settings.ego_motion:
            other._poses = self._poses
        return other

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the ego motion and returns the flow of static points.

        Raises:
            SweepError: If a sweep cannot follow the one before it.
        """
        clock = StageClock(_CPU)
        with clock.stage("ego motion"):
            self._poses.use_threads(limit_threads(self.settings.compute))
            poses = self._poses.of(triplet)
            current, following = (
                poses[sweep].world_from_sensor for sweep in (triplet.current, triplet.next)
            )
            flow = rigid_flow(triplet.current.xyz, np.linalg.inv(following) @ current)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)
