# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online method: from three sweeps to the flow of the middle one, step by step."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from typing import TypeVar

import numpy as np

from mnsf_ros.core.compute_device import check_device
from mnsf_ros.core.flow_estimate import Effort, FlowEstimate
from mnsf_ros.core.reason import Verdict
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.online.first_guess import with_first_guesses
from mnsf_ros.online.gate import with_verdicts
from mnsf_ros.online.motions import fit_motion_field, fuse_motions
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.output import flow_of, to_points
from mnsf_ros.online.preparation import Preparation, PreparedSweeps, Scene
from mnsf_ros.online.reasons import Reasons
from mnsf_ros.online.splitting import rejoined, split
from mnsf_ros.online.suspects import with_suspects
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.tracker import Measurements, Tracker, track_prior
from mnsf_ros.online.turning import with_turns
from mnsf_ros.settings import Settings
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
    """

    def __init__(self, settings: Settings, track_ids: Iterator[int] | None = None) -> None:
        """Makes an estimator that has seen nothing yet.

        Args:
            settings: Its settings.
            track_ids: Of tracks that begin; default: from 1.

        Raises:
            SettingsError: If the device in the settings is not available.
        """
        # It runs on the CPU, but a device that is not available is an error here too.
        check_device(settings.compute)
        self.settings = settings
        self.traits = MethodTraits(
            num_sweeps=3,
            carries_state=True,
            max_gap_s=settings.ego_motion.max_gap_s,
        )
        self._preparation = Preparation(settings)
        self._tracker = Tracker(settings.warm_start, track_ids or count(1))

    def renewed(self: _Own, settings: Settings) -> _Own:
        """An estimator that knows only the own body; its tracks get other ids than these."""
        renewed = type(self)(settings, self._tracker.new_ids)
        renewed._preparation.begin_with(self._preparation)
        return renewed

    def prepare(self, triplet: SweepTriplet) -> PreparedSweeps:
        """Prepares the sweeps of a triplet: ego motion, crop, ground, own body, objects.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep.
        """
        return self._preparation.prepare(triplet)

    def estimate(
        self,
        triplet: SweepTriplet,
        cancelled: Callable[[], bool] = never,
        prepared: PreparedSweeps | None = None,
        effort: Effort = Effort.FULL,
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Args:
            triplet: Three sweeps, or two if `previous` is None, each in its own sensor frame.
            cancelled: Asked between the steps; True ends the estimate with CancelledError.
            prepared: Result of `prepare` for the triplet; None: `prepare` is called first.
            effort: Less leaves out older sweeps, thus also splitting, and suspects.

        Raises:
            SweepError: As of `prepare`.
            CancelledError: If `cancelled` says so.
        """
        clock, start_kind = StageClock(cancelled), self._tracker.start
        if prepared is not None:
            clock.times_ms["prepare"] = prepared.time_ms
        with clock.stage("prepare"):
            prepared = prepared or self.prepare(triplet)
            scene = Scene.of(triplet, prepared, self.settings.objects, effort)
            scene = scene.with_current(split(scene.current, scene.targets.past))
        stamp_ns, interval_s = triplet.current.stamp_ns, scene.interval_s
        world_from_sensor = scene.current.pose.world_from_sensor
        with clock.stage("suspects"):
            objects = ObjectPoints.of(scene.current, scene.settings)
            tracks = self._tracker.predicted(stamp_ns, interval_s)
            prior = track_prior(tracks, objects, world_from_sensor, interval_s)
            wholes = scene.current.wholes[objects.numbers]
            table = ObjectTable.begun(objects, wholes, prior, scene.targets)
            if scene.targets.next.sweep.pose.lost:
                # As if all moved: what does is not told apart. Tracks are predicted.
                table = table.rejected(table.open_rows, Verdict.EGO_MOTION_LOST)
            else:
                table = with_suspects(table, scene.targets, scene.settings.max_suspects)
        table = self.find_motions(table, scene, clock)
        with clock.stage("gate"):
            table = with_verdicts(table, scene)
            scene = replace(scene, current=rejoined(scene.current, table.movers.points.numbers))
        with clock.stage("turning"):
            table = with_turns(table, scene)
        with clock.stage("tracks"):
            measured = Measurements.of(table, world_from_sensor, scene.usual_interval_s)
            tracks, track_ids = self._tracker.update(tracks, measured, stamp_ns, interval_s)
            table = table.with_tracks(track_ids)
        with clock.stage("output"):
            over_ground = to_points(scene, table, tracks)
            flow = flow_of(scene, over_ground)
        return FlowEstimate(
            flow=flow,
            kept=scene.current.kept,
            times_ms=clock.times_ms,
            start=start_kind,
            over_ground=over_ground,
            num_left_out=int(np.count_nonzero(table.verdicts == Verdict.LEFT_OUT)),
            own_body=chosen_points(triplet.current.xyz, scene.current.own),
            effort=effort,
            reason_of=Reasons(scene, table),
        )

    def find_motions(self, table: ObjectTable, scene: Scene, clock: StageClock) -> ObjectTable:
        """Fills `first_guess` and `fitted`, and rejects suspects that no motion explains better.

        First guess, forward field, backward field, inversion, fusion.

        Args:
            table: All objects; the open ones are suspects.
            scene: The sweeps.
            clock: Of the estimate.
        """
        with clock.stage("first guess"):
            table = with_first_guesses(table, scene)
        rows, targets = table.open_rows, scene.targets
        suspects = table.select(rows)
        objects, first_guess, prior = suspects.points, suspects.first_guess, suspects.prior
        with clock.stage("forward"):
            forward = fit_motion_field(objects, targets.next, first_guess)
        inverted = None
        if targets.previous is not None:
            with clock.stage("backward"):
                backward = fit_motion_field(objects, targets.previous, first_guess)
                inverted = backward / np.float32(targets.previous.time_ratio)
        with clock.stage("fusion"):
            others = prior.candidates(first_guess)
            fitted = fuse_motions(objects, targets, forward, inverted, others, prior)
        return table.put(rows, fitted=fitted)
