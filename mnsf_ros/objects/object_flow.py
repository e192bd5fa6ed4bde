# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online method: from three sweeps to the flow of the middle one, step by step."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import check_device
from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.objects.decision import Decision
from mnsf_ros.objects.encoded_field import Heads, turning, turns_of
from mnsf_ros.objects.motion_memory import MotionMemory
from mnsf_ros.objects.motions import JudgedMotions, best_of, fit_motion_field, fuse_motions, judge
from mnsf_ros.objects.over_ground import flow_of, spread
from mnsf_ros.objects.proposals import Proposals, Suspects, first_guesses
from mnsf_ros.objects.reasons import Reasons
from mnsf_ros.objects.scene import PreparedSweeps, ReadySweeps, Scene
from mnsf_ros.objects.tracks import Track
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_Own = TypeVar("_Own", bound="ObjectFlowEstimator")


class ObjectFlowEstimator:
    """Estimates scene flow as ego motion plus one motion for each object that moves.

    The structure is that of the paper: a forward field, a backward field, inversion, fusion. The
    fields are one motion for each object instead of networks, and the sensor's own motion is found
    first.

    `prepare` and `estimate` share nothing but what the one hands to the other: each may have a
    thread of its own.

    Attributes:
        settings: How it estimates.
        traits: It uses three sweeps, or two where there is no previous one.
    """

    def __init__(self, settings: Settings) -> None:
        """Makes an estimator that has seen nothing yet.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        # It runs on the CPU, but a device that is not available is an error here too.
        check_device(settings.compute)
        self.settings = settings
        self.traits = MethodTraits(
            num_sweeps=3,
            carries_state=True,
            max_gap_s=min(settings.ego_motion.max_gap_s, settings.warm_start.max_gap_s),
        )
        self._sweeps = PreparedSweeps(settings)
        self._memory = MotionMemory(settings)

    def with_settings(self: _Own, settings: Settings) -> _Own:
        """An estimator with other settings; it keeps all state that still holds."""
        other = type(self)(settings)
        is_same_world = self._sweeps.are_same_for(settings)
        other._sweeps = self._sweeps.with_settings(settings)
        other._memory = self._memory.with_settings(settings, is_same_world=is_same_world)
        return other

    def prepare(self, triplet: SweepTriplet) -> ReadySweeps:
        """Makes the sweeps of a triplet ready: ego motion, crop, ground, objects.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep.
        """
        return self._sweeps.ready(triplet)

    def estimate(
        self,
        triplet: SweepTriplet,
        cancelled: Callable[[], bool] = never,
        prepared: ReadySweeps | None = None,
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Args:
            triplet: Three sweeps, or two if `previous` is None, each in its own sensor frame.
            cancelled: Asked between the steps; True ends the estimate with CancelledError.
            prepared: What `prepare` made of the triplet; None: that is done first.

        Raises:
            SweepError: As of `prepare`.
            CancelledError: If `cancelled` says so.
        """
        clock = StageClock(cancelled)
        if prepared is not None:
            clock.times_ms["prepare"] = prepared.time_ms
        with clock.stage("prepare"):
            ready = self.prepare(triplet) if prepared is None else prepared
            scene = Scene.of(triplet, ready, self._memory, self.settings.objects)
        proposals = Proposals.of(scene, self.guesses, clock)
        starts = proposals.start[proposals.are_worth]
        moving = self.moved(proposals.fitted, scene, starts, clock)
        with clock.stage("gate"):
            decision = Decision.of(proposals, moving, scene)
            current = scene.current.with_parts_beside(decision.movers.numbers)
            scene = replace(scene, current=current)
        with clock.stage("turns"):
            heads = self.heads(scene, decision)
        with clock.stage("tracks"):
            tracks, ids = self._followed(scene, decision, heads)
        with clock.stage("output"):
            over_ground = spread(scene, decision, heads, tracks, ids)
            flow = flow_of(scene.current, over_ground)
        return FlowEstimate(
            flow=flow,
            kept=scene.current.kept,
            times_ms=clock.times_ms,
            start=scene.start,
            over_ground=over_ground,
            num_left_out=len(proposals.suspects) - len(proposals.searched),
            reason_of=Reasons(scene, decision),
        )

    def _followed(
        self, scene: Scene, decision: Decision, heads: Heads
    ) -> tuple[list[Track], NDArray[np.int64]]:
        """The tracks after this sweep, and the track numbers of its movers."""
        stamp_ns, seen = scene.current.sweep.stamp_ns, decision.seen
        are_moving = decision.are_movers
        turn_rates = np.zeros(len(seen))
        turn_rates[seen.groups[are_moving]] = turns_of(heads) / scene.usual_interval_s
        seen = replace(seen, turn_rates=turn_rates)
        tracks, ids = self._memory.follow(scene.tracks, seen, stamp_ns, scene.interval_s)
        return tracks, ids[are_moving]

    def guesses(
        self, suspects: Suspects, scene: Scene, clock: StageClock
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Where the fits of K suspects start, (K, 3) metres, and (K,) whether one is worth it."""
        return first_guesses(suspects, scene, clock)

    def moved(
        self, suspects: Suspects, scene: Scene, start: NDArray[np.float32], clock: StageClock
    ) -> JudgedMotions:
        """Forward field, backward field, inversion, fusion.

        Args:
            suspects: K objects.
            scene: The other sweeps.
            start: (K, 3) metres to the next sweep, where the fits start.
            clock: Of the estimate.
        """
        objects, targets = suspects.objects, scene.targets
        next_, *previous = targets.near
        others, surprise = suspects.expected.beside(start), suspects.expected.surprise
        with clock.stage("fit to next"):
            forward = fit_motion_field(objects, next_, start)
        if not previous:
            with clock.stage("best motion"):
                return best_of(objects, targets, judge(objects, targets, forward), others, surprise)
        with clock.stage("fit to previous"):
            backward = fit_motion_field(objects, previous[0], start)
        inverted = backward / np.float32(previous[0].steps)
        with clock.stage("best motion"):
            return fuse_motions(objects, targets, forward, inverted, others, surprise)

    def heads(self, scene: Scene, decision: Decision) -> Heads:
        """How the movers move and turn."""
        movers, seen = decision.movers, decision.seen
        motions, groups = seen.motions[seen.are_moving], decision.groups
        expected = decision.fitted.expected.only(decision.is_moving).turn_rates
        turns = np.zeros(len(motions))
        turns[groups] = expected * scene.usual_interval_s
        return turning(movers, groups, motions, turns, scene.targets)
