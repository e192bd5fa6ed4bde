# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What an estimate gives: the flow, and how it came about."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.reason import Reason
from mnsf_ros.sweeps.sweep import Start


class StopReason(Enum):
    """Why an optimization ended."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    TIME_BUDGET = "time_budget"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True)
class OptimizationResult:
    """How an optimization went.

    Attributes:
        loss_m: Lowest loss where all points are used in each step, else the last one.
        iterations: Steps taken.
        stop_reason: Why it ended.
    """

    loss_m: float
    iterations: int
    stop_reason: StopReason


@dataclass(frozen=True, eq=False)
class TrackedObject:
    """Something that moves over ground and is followed from sweep to sweep.

    Attributes:
        track_id: Number from 1; the same as long as the object is followed, never used again.
        center: (3,) float64, metres, the middle of its box, frame of the current sweep.
        size: (3,) float64, metres: length along `yaw`, width, height.
        yaw: Its heading in radians about z, from x of the current sweep.
        velocity: (3,) float64, metres per second over ground, axes of the current sweep.
        covariance: (6, 6) float64 of `center` and `velocity`, in their units.
        age_s: Seconds since it was first seen to move.
        num_points: Points of the current sweep that belong to it; 0 if it is hidden at present and
            its motion is predicted.
    """

    track_id: int
    center: NDArray[np.float64]
    size: NDArray[np.float64]
    yaw: float
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]
    age_s: float
    num_points: int

    def __repr__(self) -> str:
        """Number, speed and points, not its arrays."""
        speed = float(np.linalg.norm(self.velocity))
        return (
            f"TrackedObject(track_id={self.track_id}, speed={speed:.1f} m/s, "
            f"num_points={self.num_points})"
        )


@dataclass(frozen=True, eq=False)
class OverGround:
    """What an estimate says beside the flow if it knows how the sensor itself moved.

    Attributes:
        motion: (N, 3) float32, metres until the next sweep, over ground: without the sensor's own
            motion, in the axes of the current sweep.
        dynamic: (N,) bool, the points that move over ground.
        confidence: (N,) float32 from 0 to 1, how likely the flow is less than 0.1 m off.
        world_from_sensor: (4, 4) float64, where the current sweep was taken. The world is the
            sensor frame of the first sweep.
        next_from_current: (4, 4) float64, motion of what stands still.
        source: What the sensor's motion was taken from.
        pose_covariance: (6, 6) float64 of `world_from_sensor`, in the axes of the world: x, y, z
            in metres, then rotations about them in radians. None if nobody knows.
        motion_covariance: (6, 6) float64, the same of the sensor's motion until the next sweep, in
            the axes of the sensor.
        objects: What moves, object by object, of methods that know objects.
        track_ids: (N,) int32, the `track_id` of each point's object, 0 for points of none. None of
            methods that know no objects.
    """

    motion: NDArray[np.float32]
    dynamic: NDArray[np.bool_]
    confidence: NDArray[np.float32]
    world_from_sensor: NDArray[np.float64]
    next_from_current: NDArray[np.float64]
    source: str
    pose_covariance: NDArray[np.float64] | None = None
    motion_covariance: NDArray[np.float64] | None = None
    objects: tuple[TrackedObject, ...] = ()
    track_ids: NDArray[np.int32] | None = None

    def __repr__(self) -> str:
        """How many points are dynamic and how many objects there are, not its arrays."""
        return (
            f"OverGround(points={len(self.dynamic)}, dynamic={np.count_nonzero(self.dynamic)}, "
            f"objects={len(self.objects)}, source={str(self.source)!r})"
        )

    def part(self, rows: NDArray[np.int64]) -> OverGround:
        """Returns what is said of some points, by their numbers (M,), and all that is said else."""
        return replace(
            self,
            motion=self.motion[rows],
            dynamic=self.dynamic[rows],
            confidence=self.confidence[rows],
            track_ids=None if self.track_ids is None else self.track_ids[rows],
        )


@dataclass(frozen=True, eq=False)
class FlowEstimate:
    """The flow of the current sweep of a triplet.

    Attributes:
        flow: (N, 3) float32, metres until the next sweep, one row for each point of the current
            sweep, in its order. point + flow is where that piece of surface is in the next
            sweep's own coordinates, so the flow has the sensor's own motion in it.
        kept: (N,) bool, the points that the fields were fitted to; the others (ground, beyond
            the crop) got their flow from the same fields, or that of the sensor's own motion.
        times_ms: Stage to wall time: prepare, forward, backward, fusion, and what else there is.
        fits: Stage to result of its optimization, for forward, backward and fusion.
        start: Whether the networks were carried over from the last triplet.
        device: Where it was computed, `cpu` or `cuda`.
        distance_kind: `grid` or `tree`; empty for methods that have neither.
        precision: Of the products between hidden layers, `float32` or `bfloat16`; empty for methods
            that have none.
        over_ground: The same without the sensor's own motion, of methods that know it.
        num_left_out: Objects that there was no room to look at: they count as standing.
        reason_of: Says of rows (M,) of one thing why it was called dynamic or not, of methods that
            know objects.
    """

    flow: NDArray[np.float32]
    kept: NDArray[np.bool_]
    times_ms: dict[str, float] = field(default_factory=dict)
    fits: dict[str, OptimizationResult] = field(default_factory=dict)
    start: Start = Start.COLD_BY_SETTING
    device: str = "cpu"
    distance_kind: str = ""
    precision: str = ""
    over_ground: OverGround | None = None
    num_left_out: int = 0
    reason_of: Callable[[NDArray[np.int64]], Reason] | None = None

    def __repr__(self) -> str:
        """How many points there are, what is known of them, and the time, not its arrays."""
        known = self.over_ground
        moving = (
            ""
            if known is None
            else (f"dynamic={np.count_nonzero(known.dynamic)}, objects={len(known.objects)}, ")
        )
        return f"FlowEstimate(points={len(self.flow)}, {moving}time={self.time_ms:.1f} ms)"

    def part(self, rows: NDArray[np.int64]) -> FlowEstimate:
        """Returns the estimate of some points, by their numbers (M,)."""
        known = self.over_ground
        return replace(
            self,
            flow=self.flow[rows],
            kept=self.kept[rows],
            over_ground=None if known is None else known.part(rows),
            reason_of=None,
        )

    @property
    def time_ms(self) -> float:
        """Wall time of the whole estimate."""
        return sum(self.times_ms.values())

    @property
    def stop_reasons(self) -> dict[str, str]:
        """Stage to the word that says why its optimization ended."""
        return {stage: fit.stop_reason.value for stage, fit in self.fits.items()}


@dataclass
class StageClock:
    """Measures the stages of an estimate.

    Attributes:
        finish: Called at the end of each stage, to wait for a GPU.
        times_ms: Stage to wall time.
    """

    finish: Callable[[], None] = lambda: None
    times_ms: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to the stage's time."""
        start = time.perf_counter()
        yield
        self.finish()
        elapsed_ms = (time.perf_counter() - start) * 1e3
        self.times_ms[name] = self.times_ms.get(name, 0.0) + elapsed_ms
