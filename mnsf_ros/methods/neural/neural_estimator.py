# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's method live: from three sweeps to the flow of the middle one, step by step.

Forward field, backward field, inversion and learned fusion, as in section 3 of the paper, without
the ego motion and only for the parts of the sweep that may move. The fields are linear in an
encoding of the position, and there is one more backward field for each older sweep, as in the
paper's method for more than three sweeps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround, StageClock
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.methods.neural.carried_flow import CarriedFlow, nothing_expected
from mnsf_ros.methods.neural.decision import log_odds
from mnsf_ros.methods.neural.encoded_field import EncodedField
from mnsf_ros.methods.neural.moving_points import MovingPoints
from mnsf_ros.methods.neural.parts import Parts, best_of
from mnsf_ros.methods.neural.shift_votes import voted_shifts
from mnsf_ros.methods.neural.suspected_parts import part_numbers, suspected
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.prepared_sweeps import PreparedSweeps, ReadySweeps
from mnsf_ros.objects.target import Target
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, Start, Stretch, SweepTriplet

_POINTS_PER_PART: Final = 64
# Starts are compared on fewer.
_POINTS_PER_START: Final = 16
_NUM_VOTED: Final = 2
_COST_PER_M: Final = 0.01
# The fusion: how much residual makes a flow e times less likely, and the weight of older sweeps.
_FUSION_M: Final = 0.02
_PAST_WEIGHT: Final = 0.3
# Parts less likely to move than this log-odds are forgotten; others are expected to move.
_MIN_CARRIED: Final = -0.5


class NeuralEstimator:
    """Estimates scene flow as ego motion plus fields fitted to what may move.

    `prepare` and `estimate` may run in two threads. On the CPU only, without PyTorch.

    Attributes:
        settings: Of the estimates.
        traits: It uses three sweeps, or two if there is no previous one.
    """

    def __init__(self, settings: Settings) -> None:
        """Makes an estimator that has seen nothing yet."""
        self.settings = settings
        self.traits = MethodTraits(
            num_sweeps=3,
            carries_state=True,
            max_gap_s=min(settings.ego_motion.max_gap_s, settings.warm_start.max_gap_s),
        )
        self._sweeps = PreparedSweeps(settings)
        self._stretch: Stretch | None = None
        self._carried: CarriedFlow | None = None

    def with_settings(self, settings: Settings) -> NeuralEstimator:
        """Returns an estimator with other settings; valid state is kept."""
        other = NeuralEstimator(settings)
        other._sweeps = self._sweeps.with_settings(settings)
        if self._sweeps.are_same_for(settings):
            other._stretch, other._carried = self._stretch, self._carried
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
            prepared: The result of `prepare` for the triplet; None: it is prepared first.

        Raises:
            SweepError: As of `prepare`.
            CancelledError: If `cancelled` returns True.
        """
        clock = StageClock(cancelled)
        if prepared is not None:
            clock.times_ms["prepare"] = prepared.time_ms
        with clock.stage("prepare"):
            ready = self.prepare(triplet) if prepared is None else prepared
            *_, current, _ = ready.of_triplet
            near = ready.near(triplet.interval_ratio)
            past = ready.past(current, max(0.0, triplet.interval_s))
            interval_s = triplet.interval_s if triplet.interval_s > 0 else USUAL_INTERVAL_S
            start = self._enter(triplet.stretch)
        with clock.stage("parts"):
            numbers, parts, expected = self._suspected(current, near, past, interval_s)
        max_motion_m = self.settings.objects.max_speed_m_s * interval_s
        flow = np.zeros_like(parts.positions)
        odds: NDArray[np.float64] = np.zeros(len(parts))
        if len(parts):
            with clock.stage("start"):
                starts = _starts(parts, near, past, expected[0], max_motion_m)
            flows = _field_flows(parts, [*near, *past], starts, clock)
            with clock.stage("fusion"):
                flow = fused(parts, near, past, flows)
            with clock.stage("decision"):
                odds = log_odds(parts, near, past, flow, expected[1], max_motion_m)
        with clock.stage("output"):
            self._carry(current, parts, flow, odds, interval_s)
            motion, is_moving = self._spread(current, numbers, parts, flow, odds, [*near, *past])
            over_ground = _over_ground(current, near[0], motion, is_moving)
            flow = _with_ego_motion(current, near[0], motion, is_moving)
        return FlowEstimate(
            flow, current.kept, clock.times_ms, start=start, over_ground=over_ground
        )

    def _enter(self, stretch: Stretch) -> Start:
        """Forgets the flow of another stretch. Returns where the estimate starts."""
        if stretch is not self._stretch or not self.settings.warm_start.enabled:
            self._stretch, self._carried = stretch, None
        if not self.settings.warm_start.enabled:
            return Start.COLD_BY_SETTING
        return stretch.start if self._carried is None else Start.WARM

    def _suspected(
        self, current: ObjectSweep, near: list[Target], past: list[Target], interval_s: float
    ) -> tuple[NDArray[np.int64], Parts, tuple[NDArray[np.float32], NDArray[np.bool_]]]:
        """The part of each thinned point, the parts that may move, and what is expected of them."""
        settings = self.settings.objects
        numbers = part_numbers(current, past or near, settings.max_size_m)
        parts = Parts.of(current.thinned, numbers, settings.min_points, _POINTS_PER_PART)
        motions, are_expected = (
            nothing_expected(parts)
            if self._carried is None
            else self._carried.expected(current, parts, interval_s)
        )
        may_move = suspected(parts, near, past, are_expected)
        rows = np.flatnonzero(may_move)
        if len(rows) > settings.max_suspects:
            ranges = np.linalg.norm(parts.means(parts.positions), axis=1)
            farthest = rows[np.argsort(ranges[rows], kind="stable")[settings.max_suspects :]]
            may_move[farthest] = False
        return numbers, parts.only(may_move), (motions[may_move], are_expected[may_move])

    def _carry(
        self,
        current: ObjectSweep,
        parts: Parts,
        flow: NDArray[np.float32],
        odds: NDArray[np.float64],
        interval_s: float,
    ) -> None:
        if self.settings.warm_start.enabled:
            likely = (odds > _MIN_CARRIED)[parts.owners]
            self._carried = CarriedFlow.of(
                current, parts.positions[likely], flow[likely], interval_s
            )

    def _spread(
        self,
        current: ObjectSweep,
        numbers: NDArray[np.int64],
        parts: Parts,
        flow: NDArray[np.float32],
        odds: NDArray[np.float64],
        targets: list[Target],
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Motion over ground (N, 3) of all points of the sweep, and which of them move (N,)."""
        probability = self.settings.objects.min_probability
        moves = odds > np.log(probability / (1 - probability))
        if not moves.any():
            return np.zeros_like(current.xyz), np.zeros(len(current.xyz), np.bool_)
        movers = parts.only(moves)
        moving = MovingPoints(current, numbers, movers, flow[moves[parts.owners]])
        moving.attach(targets, self.settings.objects.max_size_m)
        return moving.of_all()


def _starts(
    parts: Parts,
    near: list[Target],
    past: list[Target],
    expected: NDArray[np.float32],
    max_motion_m: float,
) -> NDArray[np.float32]:
    """(K, 3) metres to the next sweep: none, the expected or a voted motion."""
    few = parts.thinner(_POINTS_PER_START)
    voted = voted_shifts(few, near, max_motion_m, _NUM_VOTED)
    candidates = [np.zeros_like(expected), expected, *voted]
    return best_of(few, [*near, *past], candidates, _COST_PER_M)


def _field_flows(
    parts: Parts,
    targets: Sequence[Target],
    starts: NDArray[np.float32],
    clock: StageClock,
) -> list[NDArray[np.float32]]:
    """(P, 3) metres each, of the field to each target, inverted: all of them to the next sweep."""
    few = parts.thinner(_POINTS_PER_START)
    with clock.stage("forward"):
        field = EncodedField(parts)
    flows: list[NDArray[np.float32]] = []
    for number, target in enumerate(targets):
        with clock.stage("backward" if number else "forward"):
            known = [starts, *(parts.means(flow).astype(np.float32) for flow in flows)]
            start = best_of(few, [*targets[: number + 1]], known)[parts.owners]
            steps = np.float32(target.steps)
            flows.append(field.fitted(target, steps * start) / steps)
    return flows


def fused(
    parts: Parts,
    near: Sequence[Target],
    past: Sequence[Target],
    flows: list[NDArray[np.float32]],
) -> NDArray[np.float32]:
    """Fuses flows to the next sweep with weights learned for each part.

    The weights w of a part minimize the sum of w_k D_k plus a constant times their negative
    entropy, D_k being the residual of flow k: this is a softmax of the residuals.

    Args:
        parts: K parts.
        near: The neighbouring sweeps.
        past: Older sweeps.
        flows: (P, 3) metres each: forward flow, inverted backward flows.

    Returns:
        (P, 3) metres.
    """
    # The mean of f and f' is a candidate of its own: their errors often have opposite signs.
    candidates = np.stack([*flows, (flows[0] + flows[len(near) - 1]) / 2])

    def mean_residual(targets: Sequence[Target], flow: NDArray[np.float32]) -> NDArray[np.float64]:
        residuals = [parts.point_residuals(target, flow) for target in targets]
        return parts.means(np.mean(residuals, axis=0))

    losses = np.stack([mean_residual(near, flow) for flow in candidates])
    if past:
        losses += _PAST_WEIGHT * np.stack([mean_residual(past, flow) for flow in candidates])
    weights = np.exp((losses.min(axis=0) - losses) / _FUSION_M)
    weights /= weights.sum(axis=0)
    own = weights[:, parts.owners, None]
    return np.asarray((own * candidates).sum(axis=0), np.float32)


def _over_ground(
    current: ObjectSweep,
    following: Target,
    motion: NDArray[np.float32],
    is_moving: NDArray[np.bool_],
) -> OverGround:
    pose = following.sweep.pose
    return OverGround(
        motion=motion,
        dynamic=is_moving,
        # Fields do not know how sure they are.
        confidence=np.full(len(motion), np.nan, np.float32),
        world_from_sensor=current.pose.world_from_stamp,
        next_from_current=following.from_current,
        source=pose.source.value,
        pose_covariance=current.pose.covariance,
        motion_covariance=pose.step_covariance,
    )


def _with_ego_motion(
    current: ObjectSweep,
    following: Target,
    motion: NDArray[np.float32],
    is_moving: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """(N, 3) metres, the flow of all points: motion over ground, then that of the sensor."""
    sweep, from_current = current.sweep, following.from_current
    # (R - I) p + t, not (R p + t) - p: far from the origin the difference would lose digits.
    flow = transformed(sweep.xyz, from_current - np.diag((1.0, 1.0, 1.0, 0.0)))
    rows = np.flatnonzero(is_moving)
    moved = motion[rows]
    if current.pose.motion is not None and sweep.times_s is not None:
        moved = current.pose.motion.turned_back(moved, sweep.times_s[rows])
    flow[rows] += turned(moved, from_current[:3, :3])
    return flow
