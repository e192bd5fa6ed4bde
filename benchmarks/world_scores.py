# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scores of a method on sweeps with truth: each estimate, and all of a random world."""

import math
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pandas as pd
from drives import TrueSweep, World
from mover_kinds import mover_kinds
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.metrics import by_motion, end_point_errors
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow, TrueMotion, mover_row
from mnsf_ros.evaluation.scoring import ResultRow, empty_row, true_motion
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, SurfaceClass
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import NANOSECONDS, SweepTriplet

# The first sweeps have no past and are not scored.
NUM_FIRST: Final = 3
# Every so many sweeps of a world are estimated from scratch, too.
_SCRATCH_EVERY: Final = 6
_LEAST_PRECISION: Final = 0.95
_MIN_POINTS: Final = 20
# Bands of confidence, and the largest error of a point that deserves it.
_CONFIDENCE_EDGES: Final = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 1.0001)
_CLOSE_M: Final = 0.1
_MIN_FALSE_POINTS: Final = 10
_MAX_RANGE_M: Final = 50.0
# Points between this speed and that of dynamic points are neither wrong nor missed.
_CREEPING_M_S: Final = 0.25
# A braking vehicle moves until it is slower than 0.02 m in 0.1 s; its last second counts.
_SLOWEST_M_S: Final = 0.2
_BRAKING_S: Final = 1.0
_GRACE_S: Final = 0.5
_VEHICLES: Final = (SurfaceClass.CAR, SurfaceClass.LARGE_VEHICLE, SurfaceClass.CYCLIST)
_UNKNOWN_POSE: Final = np.full((4, 4), np.nan)


@dataclass(frozen=True, eq=False)
class Scored:
    """A scored estimate.

    Attributes:
        row: Its row; movers also over ground points where their truth is known.
        truth: True motion of the M points that are judged.
        has_stopped: (M,) whether they moved lately, and may still be called dynamic.
        called: (M,) whether they are called dynamic.
        confidence: (M,) of them.
        errors_m: (M,) end point errors of their flow.
        own_body_moves: 1 if the own body is called a mover, 0 if not; NaN if it is out of view.
        ego_error_m: Error of the translation from stamp to stamp, since the last sweep; NaN from
            scratch.
        cpu_ms: CPU time of the estimate.
    """

    row: ResultRow
    truth: TrueMotion
    has_stopped: NDArray[np.bool_]
    called: NDArray[np.bool_]
    confidence: NDArray[np.float32]
    errors_m: NDArray[np.float64]
    own_body_moves: float
    ego_error_m: float = math.nan
    cpu_ms: float = math.nan

    @property
    def is_static(self) -> NDArray[np.bool_]:
        """Whether the points (M,) must not be called dynamic."""
        return (self.speed_m_s <= _CREEPING_M_S) & ~self.has_stopped

    @property
    def speed_m_s(self) -> NDArray[np.float64]:
        """True speeds (M,) over ground."""
        return np.linalg.norm(self.truth.velocity, axis=1)

    @property
    def range_m(self) -> NDArray[np.float64]:
        """Horizontal distances (M,) from the sensor."""
        return np.hypot(*self.truth.xyz[:, :2].T.astype(np.float64))


def scored(
    name: str,
    sweeps: Sequence[TrueSweep],
    counted: range,
    *,
    method: str = "online",
    from_scratch: bool = False,
    with_ground: bool = False,
) -> Iterator[Scored]:
    """Runs a method over a recording and yields each counted estimate, with `name` in its row.

    From scratch, each estimate has two sweeps and no past; else all sweeps up to the last counted
    one are estimated. With ground, what is called a mover there is a false one.
    """
    estimator, last_pose = make_method(method, preset("online")), _UNKNOWN_POSE
    for index in counted if from_scratch else range(1, counted[-1] + 1):
        previous, current, next_ = (each.sweep for each in sweeps[index - 1 : index + 2])
        if from_scratch:
            estimator, previous = make_method(method, preset("online")), None
        start_s = time.process_time()
        estimate = estimator.estimate(SweepTriplet(previous, current, next_))
        cpu_ms = 1e3 * (time.process_time() - start_s)
        pose = estimate.over_ground.world_from_sensor
        if index in counted:
            one = _scored(name, index, sweeps, estimate, with_ground=with_ground)
            true_step = np.linalg.inv(sweeps[index - 1].pose) @ sweeps[index].pose
            off = np.linalg.inv(true_step) @ np.linalg.inv(last_pose) @ pose
            yield replace(one, ego_error_m=float(np.linalg.norm(off[:3, 3])), cpu_ms=cpu_ms)
        last_pose = _UNKNOWN_POSE if from_scratch else pose


def _scored(
    name: str, index: int, sweeps: Sequence[TrueSweep], estimate: FlowEstimate, *, with_ground: bool
) -> Scored:
    current, over_ground = sweeps[index], estimate.over_ground
    flow = current.truth.flow
    # With points that the method takes for ground, such as the bottoms of vehicles.
    inside = crop_mask(current.sweep.xyz, preset("online").crop)
    above = np.flatnonzero(current.scored & inside)
    known = (current.scored | current.truth.ground if with_ground else current.scored) & inside
    example, rows = _example(name, index, sweeps, known), np.flatnonzero(known)
    truth, _ = true_motion(example, example.truth, rows)
    has_stopped = np.isin(truth.object_id, _moved_lately(sweeps, index))
    has_stopped &= np.linalg.norm(truth.velocity, axis=1) <= _CREEPING_M_S
    row = replace(
        empty_row(example, name),
        errors=by_motion(estimate.flow[above], flow[above], current.truth.dynamic[above]),
        movers=_movers(truth, ~has_stopped, estimate, rows),
    )
    called, confidence = over_ground.dynamic[rows], over_ground.confidence[rows]
    errors_m = end_point_errors(estimate.flow[rows], flow[rows])
    own_body = over_ground.dynamic[current.truth.class_id == SurfaceClass.OWN_BODY]
    own_body_moves = float(own_body.sum() >= _MIN_FALSE_POINTS) if len(own_body) else math.nan
    return Scored(row, truth, has_stopped, called, confidence, errors_m, own_body_moves)


def _example(
    name: str, index: int, sweeps: Sequence[TrueSweep], known: NDArray[np.bool_]
) -> Example:
    """A sweep with its truth, valid where it is known."""
    current, next_ = sweeps[index : index + 2]
    motion = np.linalg.inv(next_.pose) @ current.pose
    triplet = SweepTriplet(None, current.sweep, next_.sweep, next_from_current=motion)
    return Example(name, index, triplet, replace(current.truth, valid=known))


def _movers(
    truth: TrueMotion,
    judged: NDArray[np.bool_],
    estimate: FlowEstimate,
    rows: NDArray[np.int64],
) -> MoverRow:
    """Scores the movers of the judged ones among the points with truth."""
    names = ("xyz", "velocity", "dynamic", "class_id", "object_id")
    truth = replace(truth, **{name: getattr(truth, name)[judged] for name in names})
    return mover_row(truth, estimate.over_ground, rows[judged], estimate.reason_of)


def _moved_lately(sweeps: Sequence[TrueSweep], index: int) -> NDArray[np.uint32]:
    """Numbers of the objects that moved within half a second before a sweep."""
    since_ns = sweeps[index].sweep.stamp_ns - _GRACE_S * NANOSECONDS
    lately = [one.truth for one in sweeps[:index] if one.sweep.stamp_ns >= since_ns]
    return np.unique(np.concatenate([one.object_id[one.dynamic] for one in lately]))


@dataclass(frozen=True, eq=False)
class WorldScore:
    """Scores of one world.

    Attributes:
        seed, lidar, text: As in `World`.
        scenario: `random` or `standing`.
        method: Name of the method.
        figures: Name to figure; NaN where there is nothing to judge.
        confidence: Band, and whether from scratch, to number of points called dynamic, sum of their
            confidence, and number of those with less than 0.1 m of error.
        errors_m: Kind of mover to the mean end point error of each mover in each sweep.
    """

    seed: int
    lidar: str
    text: str
    scenario: str
    method: str
    figures: dict[str, float]
    confidence: dict[tuple[int, bool], NDArray[np.float64]]
    errors_m: dict[str, list[float]]


def world_score(world: World, scenario: str = "random", method: str = "online") -> WorldScore:
    """Runs a method over a world, and on some sweeps from scratch, and scores it."""
    counted = range(NUM_FIRST, len(world.sweeps) - 1)
    run, scratch = (
        list(scored(method, world.sweeps, part, method=method, **kind, with_ground=True))
        for part, kind in ((counted, {}), (counted[::_SCRATCH_EVERY], {"from_scratch": True}))
    )
    summary, first = (summarize(one.row for one in each).iloc[0] for each in (run, scratch))
    held, released = _braking(pd.concat([_objects(one) for one in run]))
    figures = {
        "recall": _recall([_called_points(one) for one in run]),
        "found": found_share(item for one in run for item in one.row.movers.objects),
        "false movers": summary["movers.ghosts_per_sweep"],
        "dynamic EPE": summary["errors.dynamic.epe_m"],
        "static EPE": summary["errors.static.epe_m"],
        "dynamic EPE, two sweeps": first["errors.dynamic.epe_m"],
        "pedestrians": summary.get("movers.pedestrians, to 30 m.found", math.nan),
        "velocity": summary["movers.velocity_error_m_s"],
        "ego motion": float(np.mean([one.ego_error_m for one in run])),
        "own body moves": float(np.mean([one.own_body_moves for one in run])),
        "cost": float(np.median([one.cpu_ms for one in run])),
        "stops": len(held),
        "held": sum(held),
        "released": sum(released),
    }
    confidence = {
        (band, is_scratch): numbers
        for is_scratch, each in ((False, run), (True, scratch))
        for band, numbers in enumerate(_by_confidence(each))
    }
    about = (world.seed, world.lidar, world.text, scenario, method)
    return WorldScore(*about, figures, confidence, _by_kind(run))


def _by_kind(run: Sequence[Scored]) -> dict[str, list[float]]:
    """Kind of mover to the mean error of each mover in each sweep, see `WorldScore`."""
    errors_m = defaultdict(list)
    for one in run:
        for own, kinds in mover_kinds(one.truth):
            for kind in kinds:
                errors_m[kind].append(float(one.errors_m[own].mean()))
    return dict(errors_m)


def _by_confidence(run: Sequence[Scored]) -> NDArray[np.float64]:
    """Numbers (B, 3) of the bands of confidence, see `WorldScore`."""
    columns = zip(*((one.confidence, one.errors_m < _CLOSE_M) for one in run), strict=True)
    judged = np.concatenate([one.called & ~one.has_stopped for one in run])
    confidence, is_close = (np.concatenate(column)[judged] for column in columns)
    bands = np.searchsorted(_CONFIDENCE_EDGES, confidence, side="right") - 1
    weights = (None, confidence, is_close)
    num_bands = len(_CONFIDENCE_EDGES) - 1
    return np.column_stack([np.bincount(bands, each, num_bands) for each in weights])


# Confidence of the points called dynamic, whether they are, and how many dynamic points there are.
_Called = tuple[NDArray[np.float32], NDArray[np.bool_], int]


def _called_points(one: Scored) -> _Called:
    """Within range, of dynamic points only those of objects that are large enough."""
    truth, near = one.truth, one.range_m <= _MAX_RANGE_M
    sizes = np.bincount(truth.object_id[near], minlength=int(truth.object_id.max()) + 1)
    is_large = sizes[truth.object_id] >= _MIN_POINTS
    is_mover = truth.dynamic & is_large
    called = near & one.called & (is_mover | one.is_static)
    return one.confidence[called], is_mover[called], int(np.count_nonzero(is_mover & near))


def _recall(called: Sequence[_Called]) -> float:
    """Largest recall of dynamic points over limits of confidence with enough precision."""
    confidence, is_right = (np.concatenate([each[part] for each in called]) for part in (0, 1))
    number = sum(each[2] for each in called)
    if number == 0:
        return math.nan
    _, owners = np.unique(-confidence, return_inverse=True)
    right, said = (np.cumsum(np.bincount(owners, each)) for each in (is_right, None))
    return float(right[right >= _LEAST_PRECISION * said].max(initial=0) / number)


def found_share(objects: Iterable[ObjectRow]) -> float:
    """Share of movers within range, sweep by sweep, that are found."""
    found = [one.is_found for one in objects if one.moves and one.range_m <= _MAX_RANGE_M]
    return float(np.mean(found)) if found else math.nan


def _objects(one: Scored) -> pd.DataFrame:
    """The objects that are near and large enough: their speeds, and whether called movers."""
    points = pd.DataFrame(
        {
            "object_id": one.truth.object_id,
            "class_id": one.truth.class_id,
            "speed_m_s": one.speed_m_s,
            "called": one.called,
        }
    )[(one.truth.object_id > 0) & (one.range_m <= _MAX_RANGE_M)]
    groups = points.groupby("object_id")
    objects = groups.mean()[groups.size() >= _MIN_POINTS].reset_index()
    return objects.assign(time_s=one.row.stamp_ns / NANOSECONDS, is_called=objects["called"] >= 0.5)


def _braking(objects: pd.DataFrame) -> tuple[list[bool], list[bool]]:
    """Of each found vehicle that stops: if it was called a mover until then, and not after."""
    held, released = [], []
    vehicles = objects[objects["class_id"].isin(_VEHICLES)]
    for _, own in vehicles.groupby("object_id"):
        found = own["is_called"] & (own["speed_m_s"] >= DYNAMIC_SPEED_M_S)
        stands = own["speed_m_s"] < _SLOWEST_M_S
        stops_s = own["time_s"][stands & found.cumsum().astype(bool)]
        if stops_s.empty:
            continue
        stop_s = stops_s.iloc[0]
        brakes = own["time_s"].between(stop_s - _BRAKING_S, stop_s, inclusive="left")
        brakes &= own["time_s"] >= own["time_s"][found].iloc[0]
        later = stands & (own["time_s"] >= stop_s + _GRACE_S)
        held.append(bool(own["is_called"][brakes].all()))
        released.append(not own["is_called"][later].any())
    return held, released
