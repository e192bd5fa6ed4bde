"""Any method in a world that stands still: sweeps are moved into the frame of the current one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround, StageClock
from mnsf_ros.core.scene_flow_estimator import MethodTraits, SceneFlowEstimator, never
from mnsf_ros.ego_motion.ego_motion import SensorPose
from mnsf_ros.ego_motion.triplet_poses import TripletPoses
from mnsf_ros.geometry.rigid_motion import rigid_flow, transformed
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, Sweep, SweepTriplet

# A point that is faster over ground moves by itself: 0.05 m within a sweep at 10 Hz.
_DYNAMIC_SPEED_M_S: Final = 0.5


class CommonFrameEstimator:
    """Another method, in the sensor frame or, with `ego_motion.removed`, in a common frame.

    In the common frame it finds the ego motion first and lets the other method explain the rest.
    Not for use from several threads at once.
    """

    def __init__(self, inner: SceneFlowEstimator, poses: TripletPoses | None = None) -> None:
        """Makes an estimator.

        Args:
            inner: What estimates the flow in the common frame; it is not used by anybody else.
            poses: What knows the poses of the last sweeps; None if nothing is known yet.
        """
        self.inner = inner
        self.settings = inner.settings
        self._poses = poses or TripletPoses(self.settings.ego_motion)

    @property
    def traits(self) -> MethodTraits:
        """Those of the other method; poses are state, too."""
        traits = self.inner.traits
        removed = self.settings.ego_motion.removed
        return replace(traits, carries_state=traits.carries_state or removed)

    def with_settings(self, settings: Settings) -> CommonFrameEstimator:
        """Returns an estimator with other settings that keeps what is still valid.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        still_hold = settings.ego_motion == self.settings.ego_motion
        poses = self._poses if still_hold else None
        return CommonFrameEstimator(self.inner.with_settings(settings), poses)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Args:
            triplet: The sweeps, each in its own sensor frame.
            cancelled: Asked again and again; True ends the estimate with CancelledError.

        Returns:
            The flow with the sensor's own motion in it, as always, and what is left without it.

        Raises:
            SweepError: If a sweep cannot follow the one before it.
            MnsfError: As the other method.
        """
        if not self.settings.ego_motion.removed:
            return self.inner.estimate(triplet, cancelled)
        clock = StageClock(torch.device("cpu"))
        with clock.stage("ego motion"):
            poses = self._poses.of(triplet)
            common = _in_frame_of_current(triplet, poses)
        estimate = self.inner.estimate(common, cancelled)
        with clock.stage("output"):
            over_ground = _over_ground(triplet, poses, estimate.flow)
            points = triplet.current.xyz + estimate.flow
            flow = rigid_flow(points, over_ground.next_from_current) + estimate.flow
        return replace(
            estimate,
            flow=flow,
            times_ms=clock.times_ms | estimate.times_ms,
            over_ground=over_ground,
        )


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
    triplet: SweepTriplet, poses: dict[Sweep, SensorPose], motion: NDArray[np.float32]
) -> OverGround:
    current, following = poses[triplet.current], poses[triplet.next]
    interval_s = triplet.interval_s if triplet.interval_s > 0 else USUAL_INTERVAL_S
    return OverGround(
        motion=motion,
        dynamic=np.linalg.norm(motion, axis=1) > _DYNAMIC_SPEED_M_S * interval_s,
        # Networks do not know how sure they are.
        confidence=np.full(len(motion), np.nan, dtype=np.float32),
        world_from_sensor=current.world_from_sensor,
        next_from_current=np.linalg.inv(following.world_from_sensor) @ current.world_from_sensor,
        source=following.source.value,
    )
