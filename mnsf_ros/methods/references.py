# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reference rows for every table: zero flow, and the flow of a static world."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.ego_motion.ego_motion import SensorPoses
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet


def zero_flow(triplet: SweepTriplet, _poses: SensorPoses) -> Floats32:
    """Zero: no point moves in the sensor frame."""
    return np.zeros_like(triplet.current.xyz)


def ego_flow(triplet: SweepTriplet, _poses: SensorPoses) -> Floats32:
    """The flow of a static world, from the ego motion of the recording.

    Raises:
        SweepError: It is not known.
    """
    if triplet.next_from_current is None:
        raise SweepError(
            f"{triplet.current}: the ego motion is not known, expected "
            "next_from_current; does the recording have odometry (--odometry TOPIC or /tf)?"
        )
    return rigid_flow(triplet.current.xyz, triplet.next_from_current)


def estimated_ego_flow(triplet: SweepTriplet, poses: SensorPoses) -> Floats32:
    """The flow of a static world, from the ego motion that `online` estimates.

    In most recordings the ego motion of `ego_flow` is the ground truth itself.
    """
    found = poses.of(triplet.sweeps)
    current, following = (
        found[sweep].world_from_sensor for sweep in (triplet.current, triplet.next)
    )
    return rigid_flow(triplet.current.xyz, np.linalg.inv(following) @ current)


class ReferenceEstimator:
    """A method that fits nothing to the sweeps."""

    def __init__(
        self,
        flow_of: Callable[[SweepTriplet, SensorPoses], Floats32],
        traits: MethodTraits,
        settings: Settings,
    ) -> None:
        """Makes a new estimator."""
        self.settings, self._flow_of = settings, flow_of
        self.traits = replace(traits, is_reference=True)
        if traits.carries_state:
            self.traits = replace(self.traits, max_gap_s=settings.ego_motion.max_gap_s)
        self._poses = SensorPoses(settings.ego_motion)

    def renewed(self, settings: Settings) -> "ReferenceEstimator":
        """Returns a new estimator of the same flow."""
        return ReferenceEstimator(self._flow_of, self.traits, settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Returns the flow of all points of the current sweep.

        Raises:
            SweepError: The ego motion is needed and not known.
        """
        clock = StageClock()
        with clock.stage("reference"):
            flow = self._flow_of(triplet, self._poses)
        return FlowEstimate(flow, np.ones(len(flow), bool), clock.times_ms)
