# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online method: from three sweeps to the flow of the middle one, step by step."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import check_device
from mnsf_ros.core.flow_estimate import Effort, FlowEstimate, StageClock, Verdict
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.online.decision import decided
from mnsf_ros.online.first_guess import first_guesses
from mnsf_ros.online.motion_memory import MotionMemory
from mnsf_ros.online.motions import JudgedMotions, best_of, fit_motion_field, fuse_motions, judge
from mnsf_ros.online.output import flow_of, to_points
from mnsf_ros.online.reasons import Reasons
from mnsf_ros.online.scene import PreparedSweeps, ReadySweeps, Scene
from mnsf_ros.online.sightings import Sightings
from mnsf_ros.online.suspects import with_suspects
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.tracks import Track
from mnsf_ros.online.turning import Heads, turning, turns_of
from mnsf_ros.settings import ObjectSettings, Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_Own = TypeVar("_Own", bound="ObjectFlowEstimator")


class ObjectFlowEstimator:
    """Estimates scene flow as ego motion plus one motion for each object that moves.

    The structure is that of the paper: a forward field, a backward field, inversion, fusion. The
    fields are one motion for each object instead of networks, and the ego motion is estimated
    first.

    `prepare` and `estimate` share only the prepared sweeps: each may run in its own thread.

    Attributes:
        settings: Settings of the estimator.
        traits: It uses three sweeps, or two where there is no previous one.
        effort: Of the next estimate.
    """

    def __init__(self, settings: Settings, track_numbers: Iterator[int] | None = None) -> None:
        """Makes an estimator that has seen nothing yet.

        Args:
            settings: Its settings.
            track_numbers: Numbers of tracks that begin; default: from 1.

        Raises:
            SettingsError: If the device in the settings is not available.
        """
        # It runs on the CPU, but a device that is not available is an error here too.
        check_device(settings.compute)
        self.settings, self.effort = settings, Effort.FULL
        self.traits = MethodTraits(
            num_sweeps=3,
            carries_state=True,
            max_gap_s=settings.ego_motion.max_gap_s,
        )
        self._sweeps = PreparedSweeps(settings)
        self._memory = MotionMemory(settings.warm_start, track_numbers or count(1))

    def renewed(self: _Own, settings: Settings) -> _Own:
        """An estimator that has seen nothing yet; its tracks get other numbers than these."""
        return type(self)(settings, self._memory.numbers)

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
            prepared: Result of `prepare` for the triplet; None: `prepare` is called first.

        Raises:
            SweepError: As of `prepare`.
            CancelledError: If `cancelled` says so.
        """
        clock, effort = StageClock(cancelled), self.effort
        if prepared is not None:
            clock.times_ms["prepare"] = prepared.time_ms
        with clock.stage("prepare"):
            ready = self.prepare(triplet) if prepared is None else prepared
            start = self._memory.start
            tracks = self._memory.expected(triplet.current.stamp_ns, triplet.interval_s)
            scene = Scene.of(triplet, ready, tracks, start, self.settings.objects, effort)
        with clock.stage("objects"):
            table = ObjectTable.of(scene)
            table = with_suspects(table, scene.targets, _max_suspects(scene.settings, effort))
        table = self._with_start(table, scene, clock)
        table = self._with_motions(table, scene, clock)
        with clock.stage("gate"):
            table = decided(table, scene)
            current = scene.current.with_parts_beside(table.movers.points.numbers)
            scene = replace(scene, current=current)
        with clock.stage("turns"):
            seen = Sightings.of(table, scene.current.pose.world_from_sensor, scene.usual_interval_s)
            heads = turning_heads(table.movers, seen, scene)
        with clock.stage("tracks"):
            tracks, ids = self._followed(scene, table.movers, seen, heads)
        with clock.stage("output"):
            over_ground = to_points(scene, table, heads, tracks, ids)
            flow = flow_of(scene.current, over_ground)
        return FlowEstimate(
            flow=flow,
            kept=scene.current.kept,
            times_ms=clock.times_ms,
            start=scene.start,
            over_ground=over_ground,
            num_left_out=int(np.count_nonzero(table.verdicts == Verdict.LEFT_OUT)),
            own_body=chosen_points(triplet.current.xyz, scene.current.own),
            effort=effort,
            reason_of=Reasons(scene, table),
        )

    def _with_start(self, table: ObjectTable, scene: Scene, clock: StageClock) -> ObjectTable:
        """Fills `start` of the suspects, and rejects those that no motion explains better."""
        rows = table.open_rows
        start, are_worth = self.guesses(table.take(rows), scene, clock)
        table = table.put(rows, start=start)
        return table.rejected(rows[~are_worth], Verdict.NO_BETTER_MOTION)

    def _with_motions(self, table: ObjectTable, scene: Scene, clock: StageClock) -> ObjectTable:
        """Fills `moving` of the objects that are left."""
        rows = table.open_rows
        return table.put(rows, moving=self.moved(table.take(rows), scene, clock))

    def _followed(
        self, scene: Scene, movers: ObjectTable, seen: Sightings, heads: Heads
    ) -> tuple[list[Track], NDArray[np.int64]]:
        """The tracks after this sweep, and the track numbers of its movers."""
        turn_rates = np.zeros(len(seen))
        turn_rates[movers.groups] = turns_of(heads) / scene.usual_interval_s
        seen = replace(seen, turn_rates=turn_rates)
        stamp_ns = scene.current.sweep.stamp_ns
        tracks, ids = self._memory.follow(scene.tracks, seen, stamp_ns, scene.interval_s)
        return tracks, ids[movers.groups]

    def guesses(
        self, table: ObjectTable, scene: Scene, clock: StageClock
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Initial motions of K suspects, (K, 3) metres, and (K,) whether a fit is worth it."""
        with clock.stage("first guess"):
            return first_guesses(table, scene)

    def moved(self, table: ObjectTable, scene: Scene, clock: StageClock) -> JudgedMotions:
        """Forward field, backward field, inversion, fusion.

        Args:
            table: K objects, with the motions that the fits start from.
            scene: The other sweeps.
            clock: Of the estimate.
        """
        objects, start, targets = table.points, table.start, scene.targets
        next_, *previous = targets.near
        others, prior_cost = table.expected.candidates(start), table.expected.prior_cost
        with clock.stage("fit to next"):
            forward = fit_motion_field(objects, next_, start)
        if not previous:
            with clock.stage("best motion"):
                return best_of(
                    objects, targets, judge(objects, targets, forward), others, prior_cost
                )
        with clock.stage("fit to previous"):
            backward = fit_motion_field(objects, previous[0], start)
        inverted = backward / np.float32(previous[0].steps)
        with clock.stage("best motion"):
            return fuse_motions(objects, targets, forward, inverted, others, prior_cost)


def _max_suspects(settings: ObjectSettings, effort: Effort) -> int:
    return max(1, settings.max_suspects // {Effort.HALF: 2, Effort.LEAST: 4}.get(effort, 1))


def turning_heads(movers: ObjectTable, seen: Sightings, scene: Scene) -> Heads:
    """The heads (K, 3, 3) of K movers: their motions and turns."""
    things, groups = np.unique(movers.groups, return_inverse=True)
    turns = np.zeros(len(things))
    turns[groups] = movers.expected.turn_rates * scene.usual_interval_s
    return turning(movers.points, groups, seen.motions[things], turns, scene.targets)
