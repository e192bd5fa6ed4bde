"""The online method: from three sweeps to the flow of the middle one, step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import check_device, usable_threads
from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.errors import CancelledError
from mnsf_ros.objects.motion_field import fit_motion_field
from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets, best_of, fuse_motions, judge
from mnsf_ros.objects.motion_memory import MotionMemory
from mnsf_ros.objects.motion_votes import voted_motions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.reasons import Reasons
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.static_gate import moves, seen_through, suspects
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_POINTS_TO_GUESS: Final = 24


class ObjectFlowEstimator:
    """Estimates scene flow as ego motion plus one motion for each object that moves.

    The structure is that of the paper: a forward field, a backward field, inversion, fusion. The
    fields are piecewise constant instead of networks, and the sensor's own motion is found first.

    Not for use from several threads at once.

    Attributes:
        settings: How it estimates.
        traits: It uses three sweeps, or two where there is no previous one.
    """

    traits = MethodTraits(num_sweeps=3, carries_state=True)

    def __init__(self, settings: Settings) -> None:
        """Makes an estimator that has seen nothing yet.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        # It runs on the CPU, but a device that is not available is an error here too.
        check_device(settings.compute)
        self.settings = settings
        self._memory = MotionMemory(settings)

    def with_settings(self, settings: Settings) -> ObjectFlowEstimator:
        """An estimator with other settings; it knows what this one does if that still holds."""
        other = ObjectFlowEstimator(settings)
        other._memory = self._memory.with_settings(settings)
        return other

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Args:
            triplet: Three sweeps, or two if `previous` is None, each in its own sensor frame.
            cancelled: Asked between the steps; True ends the estimate with CancelledError.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep.
            CancelledError: If `cancelled` says so.
        """
        self._memory.use_threads(usable_threads(self.settings.compute))
        clock = _Clock(cancelled)
        with clock.stage("prepare"):
            scene = Scene.of(triplet, self._memory, self.settings.objects.min_points)
        with clock.stage("objects"):
            objects = ObjectPoints.of(scene.current, self.settings.objects)
            suspected, all_standing = suspects(objects, scene.targets)
            nearest = suspected.are_nearest(self.settings.objects.max_suspects)
            objects, standing = suspected.only(nearest), all_standing.only(nearest)
        with clock.stage("search"):
            start = self._start(objects, scene, standing)
        moving = self._moved(objects, scene, start, clock)
        with clock.stage("gate"):
            free = seen_through(objects, scene.targets, moving.motions)
            is_moving = moves(standing, moving, free, self.settings.objects)
            known = (suspected, objects, standing, start, moving, is_moving)
            evidence = {"free space": free}
            reasons = Reasons(scene.current, self.settings.objects, *known, evidence)
            movers, moving = objects.only(is_moving), moving.only(is_moving)
            # Objects beyond the limits of the work are as uncertain as suspects.
            is_doubtful = np.ones(len(suspected), dtype=bool)
            is_doubtful[nearest] = ~is_moving
            doubtful, standing = suspected.only(is_doubtful), all_standing.only(is_doubtful)
        with clock.stage("tracks"):
            followed = self._memory.follow(scene.current, movers, moving, scene.interval_s)
        with clock.stage("output"):
            over_ground = scene.over_ground(movers, moving, doubtful, standing, *followed)
            flow = scene.flow(over_ground)
        return FlowEstimate(
            flow=flow,
            kept=scene.current.kept,
            times_ms=clock.times_ms,
            start=scene.start,
            over_ground=over_ground,
            num_left_out=len(suspected) - len(objects),
            reason_of=reasons,
        )

    def _start(
        self, objects: ObjectPoints, scene: Scene, standing: JudgedMotions
    ) -> NDArray[np.float32]:
        """(K, 3) where fits start: none, the voted motion, or that of the last triplet."""
        if len(objects) == 0:
            return standing.motions
        reach_m = self.settings.objects.max_speed_m_s * scene.usual_interval_s
        guesses = [voted_motions(objects, scene.targets.near, reach_m)]
        expected = self._memory.expected(scene.current, objects, scene.interval_s)
        guesses += [] if expected is None else [expected]
        # A rough guess needs only half the points, and only the neighbouring sweeps.
        some, near = objects.thinner(_POINTS_TO_GUESS), Targets(scene.targets.near, past=())
        judged = (judge(some, near, guess) for guess in (standing.motions, *guesses))
        return best_of(judged).motions

    def _moved(
        self, objects: ObjectPoints, scene: Scene, start: NDArray[np.float32], clock: _Clock
    ) -> JudgedMotions:
        """Forward field, backward field, inversion, fusion."""
        num_iterations = self.settings.objects.max_iterations
        next_, *previous = scene.targets.near
        with clock.stage("forward"):
            forward = fit_motion_field(objects, next_, start, num_iterations)
        if not previous:
            with clock.stage("fusion"):
                return judge(objects, scene.targets, forward.flows)
        with clock.stage("backward"):
            backward = fit_motion_field(objects, previous[0], start, num_iterations)
        inverted = backward.flows / np.float32(previous[0].steps)
        with clock.stage("fusion"):
            return fuse_motions(objects, scene.targets, forward, backward, inverted)


class _Clock(StageClock):
    """Measures stages, and ends the estimate before one if the caller asked for it."""

    def __init__(self, cancelled: Callable[[], bool]) -> None:
        super().__init__()
        self._cancelled = cancelled

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        if self._cancelled():
            raise CancelledError("the estimate was abandoned")
        with super().stage(name):
            yield
