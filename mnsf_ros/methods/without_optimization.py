"""Honest rows for every table: nothing moves, and only the sensor moves."""

from __future__ import annotations

import numpy as np
import torch

from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock
from mnsf_ros.ego_motion.triplet_poses import TripletPoses
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_CPU = torch.device("cpu")


class ZeroEstimator:
    """Says that no point moves in the sensor's frame."""

    num_sweeps = 2

    def __init__(self, settings: Settings) -> None:
        """Takes settings like every method, and needs none."""

    def estimate(self, triplet: SweepTriplet) -> FlowEstimate:
        """Estimates zero flow."""
        clock = StageClock(_CPU)
        with clock.stage("zero"):
            flow = np.zeros_like(triplet.current.xyz)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)


class EgoMotionEstimator:
    """Says that the world stands still and only the sensor moves, by the motion it is told."""

    num_sweeps = 2

    def __init__(self, settings: Settings) -> None:
        """Takes settings like every method, and needs none."""

    def estimate(self, triplet: SweepTriplet) -> FlowEstimate:
        """Estimates the flow of standing points from `triplet.next_from_current`.

        Raises:
            SweepError: If the triplet does not say how the sensor moved, or not in a (4, 4)
                transform.
        """
        if triplet.next_from_current is None:
            raise SweepError(
                f"sweep {triplet.current.stamp_ns}: nothing says how the sensor moved, expected "
                "next_from_current; does the recording have odometry?"
            )
        clock = StageClock(_CPU)
        with clock.stage("rigid"):
            flow = rigid_flow(triplet.current.xyz, triplet.next_from_current)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)


class EstimatedEgoMotionEstimator:
    """Says that the world stands still, by the same ego motion that the online method finds.

    Beside `ego`, whose motion is the recording's own and mostly that of the ground truth, too.
    """

    num_sweeps = 2

    def __init__(self, settings: Settings) -> None:
        """Makes an estimator that has seen nothing yet."""
        self._poses = TripletPoses(settings.ego_motion)

    def estimate(self, triplet: SweepTriplet) -> FlowEstimate:
        """Estimates the flow of standing points.

        Raises:
            SweepError: If a sweep cannot follow the one before it.
        """
        clock = StageClock(_CPU)
        with clock.stage("ego motion"):
            poses = self._poses.of(triplet)
            current, following = (
                poses[sweep].world_from_sensor for sweep in (triplet.current, triplet.next)
            )
            flow = rigid_flow(triplet.current.xyz, np.linalg.inv(following) @ current)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)
