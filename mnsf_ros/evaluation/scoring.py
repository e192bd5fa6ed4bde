# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scores of an estimate of an example: one row of results for each method and example."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.argoverse_metrics import Sums, bucket_sums, range_sums, three_way_sums
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.metrics import (
    RANGE_LIMITS_M,
    SPEED_LIMITS_M_S,
    FlowErrors,
    by_motion,
    end_point_errors,
    errors_by_band,
)
from mnsf_ros.evaluation.movers import MoverRow, TrueMotion, mover_row
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, rigid_flow
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, SweepTriplet

# Reason for a missing flow: a newer example replaced this one before its turn, as in the live node.
DROPPED: Final = "dropped: a newer triplet took its place"


@dataclass(frozen=True)
class ResultRow:
    """Result of one method on one example. Every field survives JSON unchanged."""

    recording: str  # name
    number: int  # index of the sweep in the recording
    stamp_ns: int
    method: str
    num_points: int  # scored points of the current sweep
    time_ms: float = math.nan  # wall time of the estimate, device synchronized; NaN if it failed
    stage_times_ms: dict[str, float] = field(default_factory=dict)
    stop_reasons: dict[str, str] = field(default_factory=dict)  # of optimizations, by stage
    iterations: dict[str, int] = field(default_factory=dict)  # by stage
    # By group of points (all, dynamic, static); empty without truth.
    errors: dict[str, FlowErrors] = field(default_factory=dict)
    # By upper limit of bins of range (m) and of true speed over ground (m/s).
    by_range: dict[str, FlowErrors] = field(default_factory=dict)
    by_speed: dict[str, FlowErrors] = field(default_factory=dict)
    sums: Sums = field(default_factory=dict)  # see `argoverse_metrics`
    consistency: dict[str, float] = field(default_factory=dict)  # see `landing_distances`
    latency_ms: float = math.nan  # from the arrival of the next sweep to the flow, in real time
    lost: str = ""  # why the ego motion is not known; empty if it is
    start: str = ""  # of the estimate, warm or cold and why; empty if the method has none
    failure: str | None = None  # reason for a missing flow, in one line
    movers: MoverRow | None = None  # with truth, of methods that find movers

    @property
    def task(self) -> tuple[str, str]:
        """Recording and method."""
        return self.recording, self.method

    @property
    def badness_m(self) -> float:
        """Rank of a sweep among the worst, metres: EPE, or without truth the landing distance."""
        errors = self.errors.get("all")
        if errors is not None and errors.num_points > 0:
            return errors.epe_m
        return self.consistency.get("nearest_m", math.nan)

    @property
    def is_dropped(self) -> bool:
        """Whether the example was dropped for a newer one."""
        return self.failure == DROPPED

    @property
    def has_failed(self) -> bool:
        """Whether the method ran and gave no flow."""
        return self.failure not in (None, DROPPED)


# Static points determine the ego motion if there are this many, with a second largest standard
# deviation of this much: not if they are close together or collinear.
_MIN_STATIC = 20
_MIN_SPREAD_M = 1.0
# Ego motion is fitted to this many parts of a sweep, by the times of their points.
_NUM_TIMES = 12


def empty_row(example: Example, method: str) -> ResultRow:
    """Returns the row of an example without any result."""
    num_points = int(np.count_nonzero(example.scored))
    stamp_ns = example.triplet.current.stamp_ns
    return ResultRow(example.recording, example.number, stamp_ns, method, num_points)


def failed_row(example: Example, method: str, failure: str) -> ResultRow:
    """Returns the row of an example without a flow, failed for a reason or dropped."""
    return replace(empty_row(example, method), failure=failure)


def scored_row(
    example: Example, method: str, estimate: FlowEstimate, time_ms: float = math.nan
) -> ResultRow:
    """Scores an estimate that took `time_ms` of wall time.

    Raises:
        EvaluationError: It is not an estimate, its flow does not have one row for each point, or is
            not finite for a kept point.
    """
    if not isinstance(estimate, FlowEstimate):
        raise EvaluationError(f"got a {type(estimate).__name__}, expected a FlowEstimate")
    row = replace(
        empty_row(example, method),
        time_ms=time_ms,
        stage_times_ms=dict(estimate.times_ms),
        stop_reasons=estimate.stop_reasons,
        iterations={stage: fit.iterations for stage, fit in estimate.fits.items()},
        lost=estimate.over_ground.lost if estimate.over_ground else "",
        start=estimate.start.value if estimate.fits or estimate.over_ground else "",
    )
    answered = _answered(example, estimate)
    looked_at = answered & example.scored
    row = replace(row, consistency=landing_distances(example.triplet, estimate.flow, looked_at))
    if example.truth is None:
        return row
    return _with_errors(row, example, example.truth, estimate, answered)


def _answered(example: Example, estimate: FlowEstimate) -> Bools:
    """The points (N,) with a flow; all kept points must have one."""
    num_points = len(example.triplet.current)
    if estimate.flow.shape != (num_points, 3) or estimate.kept.shape != (num_points,):
        raise EvaluationError(
            f"the estimate has flow of shape {estimate.flow.shape} and kept of shape "
            f"{estimate.kept.shape}, expected ({num_points}, 3) and ({num_points},)"
        )
    # Column by column: of a whole sweep that is many times faster than `all(axis=1)`.
    x, y, z = np.isfinite(estimate.flow).T
    answered = np.asarray(x & y & z)
    num_open = int(np.count_nonzero(~answered & estimate.kept))
    if num_open:
        raise EvaluationError(f"the flow of {num_open} of {num_points} points is not finite")
    return answered


def true_motion(example: Example, truth: FlowTruth, rows: Ints) -> tuple[TrueMotion, Floats]:
    """Returns the true motion of some points (M,) over ground, and its length (M,).

    The length is in metres until the next sweep. The truth must be valid for all points.
    """
    current, odometry = example.triplet.current, example.triplet.next_from_current
    truth, xyz = truth.of_points(rows), current.xyz[rows]
    own = truth.flow.astype(np.float64)
    for part in _of_one_time(None if current.times_s is None else current.times_s[rows], len(rows)):
        motion = _sensor_motion(xyz[part], truth.flow[part], truth.dynamic[part], odometry)
        # Turned back into the axes of the current sweep.
        own[part] = (own[part] - rigid_flow(xyz[part], motion)) @ motion[:3, :3]
    interval_s = example.triplet.interval_s or USUAL_INTERVAL_S
    velocity = own / interval_s
    known = (velocity, truth.dynamic, truth.class_id, truth.object_id, interval_s)
    return TrueMotion(xyz, *known), np.linalg.norm(own, axis=1)


def _of_one_time(times_s: Floats32 | None, number: int) -> list[slice] | list[Ints]:
    """Returns parts of a sweep by time, as ego motion changes in a bend; one without times."""
    if times_s is None or number < _NUM_TIMES * _MIN_STATIC:
        return [slice(None)]
    return np.array_split(np.argsort(times_s, kind="stable"), _NUM_TIMES)


def _sensor_motion(
    xyz: Floats32, true_flow: Floats32, dynamic: Bools, odometry: Floats | None
) -> Floats:
    """(4, 4) next_from_current, from the true flow of static points: odometry may be worse."""
    static = xyz[~dynamic]
    if odometry is not None and not _fix_a_motion(static):
        return odometry
    return fit_rigid_motion(static, true_flow[~dynamic])


def _fix_a_motion(xyz: Floats32) -> bool:
    if len(xyz) < _MIN_STATIC:
        return False
    variances = np.linalg.eigvalsh(np.cov(xyz.astype(np.float64).T))
    return bool(variances[1] >= _MIN_SPREAD_M**2)


def _with_errors(
    row: ResultRow, example: Example, truth: FlowTruth, estimate: FlowEstimate, answered: Bools
) -> ResultRow:
    rows = np.flatnonzero(truth.valid & answered & example.scored)
    known, own_m = true_motion(example, truth, rows)
    flow, true_flow = estimate.flow[rows], truth.flow[rows]
    xyz, dynamic, class_id, interval_s = known.xyz, known.dynamic, known.class_id, known.interval_s
    share = USUAL_INTERVAL_S / interval_s
    xy = xyz[:, :2].astype(np.float64)
    errors_m = end_point_errors(flow, true_flow)
    movers = None
    if estimate.over_ground is not None:
        movers = mover_row(known, estimate.over_ground, rows, estimate.reason_of)
    return replace(
        row,
        movers=movers,
        errors=by_motion(flow, true_flow, dynamic),
        by_range=errors_by_band(flow, true_flow, np.linalg.norm(xy, axis=1), RANGE_LIMITS_M),
        by_speed=errors_by_band(flow, true_flow, own_m / interval_s, SPEED_LIMITS_M_S),
        sums={
            **three_way_sums(errors_m, dynamic, class_id),
            **bucket_sums(errors_m * share, own_m * share, xy, class_id),
            **range_sums(errors_m * share, own_m * share, np.linalg.norm(xyz, axis=1)),
        },
    )


def landing_distances(triplet: SweepTriplet, flow: Floats32, points: Bools) -> dict[str, float]:
    """Returns the mean distance of points to the nearest point of the next sweep, metres.

    `flow` is (N, 3) metres, finite at the measured `points` (N,).

    Returns:
        `nearest_m` and, for zero flow, `zero_nearest_m`; empty if either sweep has no points.
    """
    rows, next_xyz = np.flatnonzero(points), triplet.next.kept_xyz
    if len(rows) == 0 or len(next_xyz) == 0:
        return {}
    tree = cKDTree(next_xyz)
    xyz = triplet.current.xyz[rows]
    moved, _ = tree.query(xyz + flow[rows])
    unmoved, _ = tree.query(xyz)
    return {"nearest_m": float(moved.mean()), "zero_nearest_m": float(unmoved.mean())}
