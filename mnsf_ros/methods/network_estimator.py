# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The estimator of all methods that fit networks: each method is one function on a workbench.

With `ego_motion.removed` the sweeps are first moved into the frame of the current one, so that
the networks explain only what the ego motion does not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.compute_device import compute_device, limit_threads
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.ego_motion.ego_motion import SensorPose, SensorPoses
from mnsf_ros.geometry.rigid_motion import rigid_flow, transformed
from mnsf_ros.networks.workbench import PreparedSweep, Workbench
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, Sweep, SweepTriplet

# A point that is faster over ground is dynamic: 0.05 m within a sweep at 10 Hz.
_DYNAMIC_SPEED_M_S: Final = 0.5

FlowOf = Callable[[Workbench], torch.Tensor]


@dataclass(frozen=True)
class NetworkMethod:
    """A method that fits networks."""

    flow_of: FlowOf  # fits networks on the workbench; its flow is (N, 3) metres from t to t+1
    num_sweeps: int = 2  # that the method looks at
    distance_kind: str | None = None  # if not that of `Workbench.next.distance`
    needs_previous: bool = True  # false if a method of three sweeps can do with two


class NetworkEstimator:
    """Estimates scene flow by a method that fits networks to each triplet.

    Not for use from several threads at once.

    Attributes:
        settings: Of the estimates.
        traits: Needs of the method.
    """

    def __init__(self, settings: Settings, method: NetworkMethod) -> None:
        """Makes a new estimator.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        self.settings = settings
        self._method = method
        is_removed = settings.ego_motion.removed
        self.traits = MethodTraits(
            method.num_sweeps,
            carries_state=is_removed,
            max_gap_s=settings.ego_motion.max_gap_s if is_removed else math.inf,
        )
        compute_device(settings.compute)
        self._prepared: dict[Sweep, PreparedSweep] = {}
        self._poses = SensorPoses(settings.ego_motion)

    def renewed(self, settings: Settings) -> "NetworkEstimator":
        """Returns a new estimator of the same method.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        return NetworkEstimator(settings, self._method)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Args:
            triplet: The sweeps, each in its own sensor frame.
            cancelled: Asked again and again; True ends the estimate with CancelledError.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep, or there are too
                few sweeps.
            OptimizationError: If the optimization finds no finite flow.
            CancelledError: If `cancelled` returns True.
        """
        limit_threads(self.settings.compute)
        if not self.settings.ego_motion.removed:
            return self._fitted(triplet, cancelled)
        clock = StageClock()
        with clock.stage("ego motion"):
            poses = self._poses.of(triplet.sweeps)
            common = _in_frame_of_current(triplet, poses)
        estimate = self._fitted(common, cancelled)
        with clock.stage("output"):
            over_ground = _over_ground(triplet, poses, estimate.flow)
            points = triplet.current.xyz + estimate.flow
            flow = rigid_flow(points, over_ground.next_from_current) + estimate.flow
        times_ms = clock.times_ms | estimate.times_ms
        return replace(estimate, flow=flow, times_ms=times_ms, over_ground=over_ground)

    def _fitted(self, triplet: SweepTriplet, cancelled: Callable[[], bool]) -> FlowEstimate:
        """The flow in the coordinates of the sweeps as they are."""
        is_pair = triplet.previous is None and not self._method.needs_previous
        num_before = 0 if is_pair else self._method.num_sweeps - 2
        bench = Workbench(triplet, self.settings, self._prepared, num_before, cancelled)
        return bench.finish(self._method.flow_of(bench), self._method.distance_kind)


def _in_frame_of_current(triplet: SweepTriplet, poses: dict[Sweep, SensorPose]) -> SweepTriplet:
    current_from_world = np.linalg.inv(poses[triplet.current].world_from_sensor)

    def moved(sweep: Sweep) -> Sweep:
        current_from_sensor = current_from_world @ poses[sweep].world_from_sensor
        return replace(sweep, xyz=transformed(sweep.xyz, current_from_sensor), odometry=None)

    return SweepTriplet(
        previous=None if triplet.previous is None else moved(triplet.previous),
        current=triplet.current,
        next=moved(triplet.next),
        earlier=tuple(map(moved, triplet.earlier)),
    )


def _over_ground(
    triplet: SweepTriplet, poses: dict[Sweep, SensorPose], motion: Floats32
) -> OverGround:
    current, following = poses[triplet.current], poses[triplet.next]
    interval_s = triplet.interval_s if triplet.interval_s > 0 else USUAL_INTERVAL_S
    lost = following.lost
    is_fast = np.linalg.norm(motion, axis=1) > _DYNAMIC_SPEED_M_S * interval_s
    return OverGround(
        motion=motion,
        dynamic=is_fast & (not lost),
        # Networks do not know how sure they are.
        confidence=np.full(len(motion), 0.0 if lost else np.nan, dtype=np.float32),
        world_from_sensor=current.world_from_stamp,
        next_from_current=np.linalg.inv(following.world_from_sensor) @ current.world_from_sensor,
        source=following.source.value,
        pose_covariance=current.covariance,
        motion_covariance=following.step_covariance,
        lost=lost,
    )
