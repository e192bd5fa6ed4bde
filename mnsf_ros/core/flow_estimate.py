# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The result of an estimate: flow, motion over ground, objects, timings and reasons."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import CancelledError
from mnsf_ros.sweeps.sweep import Start


class StopReason(Enum):
    """Why an optimization ended."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    TIME_BUDGET = "time_budget"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True)
class OptimizationResult:
    """The result of an optimization.

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
    """A dynamic object that is tracked from sweep to sweep.

    Attributes:
        track_id: Number from 1; the same as long as the object is tracked, never reused.
        center: (3,) float64, metres, the middle of its box, frame of the current sweep.
        size: (3,) float64, metres: length along `yaw`, width, height.
        yaw: Its heading in radians about z, from x of the current sweep.
        velocity: (3,) float64, metres per second over ground, axes of the current sweep.
        turn_rate: Radians per second about z, to the left.
        covariance: (6, 6) float64 of `center` and `velocity`, in their units.
        age_s: Seconds since it was first seen to move.
        num_points: Points of the current sweep that belong to it; 0 if it is hidden at present and
            its motion is predicted.
        outline: (K, 2) metres, the convex outline of its points from above, counter-clockwise, from
            its center along `yaw` and to the left; without rows if nobody has determined it.
    """

    track_id: int
    center: NDArray[np.float64] = field(repr=False)
    size: NDArray[np.float64] = field(repr=False)
    yaw: float
    velocity: NDArray[np.float64] = field(repr=False)
    turn_rate: float
    covariance: NDArray[np.float64] = field(repr=False)
    age_s: float
    num_points: int
    outline: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)), repr=False)


@dataclass(frozen=True, eq=False)
class OverGround:
    """Motion over ground, of methods that estimate the ego motion.

    Attributes:
        motion: (N, 3) float32, metres until the next sweep, over ground: without the ego
            motion, in the axes of the current sweep.
        dynamic: (N,) bool, the points that move over ground.
        confidence: (N,) float32 from 0 to 1, how likely the flow is less than 0.1 m off.
        world_from_sensor: (4, 4) float64, pose of the current sweep. The world is the sensor frame
            of the first sweep.
        next_from_current: (4, 4) float64, motion of static points between the two sensor frames.
        source: Source of the ego motion.
        pose_covariance: (6, 6) float64 of `world_from_sensor`, in the axes of the world: x, y, z
            in metres, then rotations about them in radians. None if unknown.
        motion_covariance: (6, 6) float64, the same of the ego motion until the next sweep, in the
            axes of the sensor.
        objects: The dynamic objects, of methods with objects.
        track_ids: (N,) int32, the `track_id` of each point's object, 0 for none. None for methods
            without objects.
    """

    motion: NDArray[np.float32] = field(repr=False)
    dynamic: NDArray[np.bool_] = field(repr=False)
    confidence: NDArray[np.float32] = field(repr=False)
    world_from_sensor: NDArray[np.float64] = field(repr=False)
    next_from_current: NDArray[np.float64] = field(repr=False)
    source: str
    pose_covariance: NDArray[np.float64] | None = field(default=None, repr=False)
    motion_covariance: NDArray[np.float64] | None = field(default=None, repr=False)
    objects: tuple[TrackedObject, ...] = ()
    track_ids: NDArray[np.int32] | None = field(default=None, repr=False)

    def part(self, rows: NDArray[np.int64]) -> "OverGround":
        """Returns the same for some points, by their numbers (M,)."""
        return replace(
            self,
            motion=self.motion[rows],
            dynamic=self.dynamic[rows],
            confidence=self.confidence[rows],
            track_ids=None if self.track_ids is None else self.track_ids[rows],
        )


class Effort(IntEnum):
    """How much a live method does for an estimate; the node takes less under load."""

    FULL = 0
    NEAR_SWEEPS = 1
    HALF = 2
    LEAST = 3

    @property
    def text(self) -> str:
        """What is left out."""
        return (
            "full",
            "without older sweeps",
            "without older sweeps, half of objects.max_suspects",
            "without older sweeps, a quarter of objects.max_suspects",
        )[self]


class Verdict(Enum):
    """Outcome for an object: the stage that decided."""

    OPEN = "not decided yet"
    GROUND = "ground"
    TOO_HIGH = "too high above the ground"
    OUTSIDE_CROP = "outside the crop"
    NO_OBJECT = "seen a second time in the same revolution"
    OWN_BODY = "the robot's own body"
    TOO_FEW_POINTS = "too few points"
    TOO_LARGE = "too large"
    NOT_SUSPECTED = "not suspected: other sweeps show it at the same place"
    LEFT_OUT = "left out: beyond objects.max_suspects (tracked movers first, then the nearest)"
    NO_BETTER_MOTION = "no motion explains it better"
    REFUSED = "refused by the gate"
    PARTLY = "a part of it moves alone"
    DYNAMIC = "dynamic"


class PointState(IntEnum):
    """What another sweep says about one point of an object."""

    UNCLEAR = 0  # a surface near by, or no return in its direction
    HIT = 1  # a return at its place
    FREE = 2  # seen through
    HIDDEN = 3  # behind something, or out of view

    @property
    def text(self) -> str:
        """Its name in tables and pictures."""
        return "passed through" if self is PointState.FREE else self.name.lower()


@dataclass(frozen=True, eq=False)
class Match:
    """An object compared with another sweep, if it is static or if it moves.

    Attributes:
        positions: (P, 3) float32, metres, where its points are by then, axes of the current sweep.
        states: (P,) uint8, the `PointState` of each.
        residual_m: Mean distance from the other sweep beyond the spacing of its points.
    """

    positions: NDArray[np.float32]
    states: NDArray[np.uint8]
    residual_m: float

    def share(self, state: PointState) -> float:
        """Share of the points in a state."""
        return float(np.mean(self.states == state))


@dataclass(frozen=True, eq=False)
class SweepTerms:
    """What another sweep says about an object.

    Attributes:
        age_s: Time from the current sweep to the other one; negative before.
        points: (Q, 3) float32, metres, points of the other sweep around the object, axes of the
            current sweep, ego motion removed.
        static: The object where it is.
        moving: The object with its motion; None if no motion was fitted.
    """

    age_s: float
    points: NDArray[np.float32]
    static: Match
    moving: Match | None


class Leader(NamedTuple):
    """The object that another one goes along with, because they touch and move alike.

    Attributes:
        place: (3,) metres, the middle of its points, sensor frame.
        probability: How likely it moves.
    """

    place: NDArray[np.float32]
    probability: float


@dataclass(frozen=True, eq=False)
class Reason:
    """Why an object was called dynamic or not.

    Attributes:
        verdict: The outcome.
        num_points: Its points after thinning.
        size_m: The longer horizontal side of the box around it.
        sweeps: What each other sweep says, the next one first; empty for what has no motion: too
            few points, or too large.
        start: (3,) metres over ground until the next sweep, where the fit of its motion started.
        motion: (3,) metres, likewise, the fitted motion; None if none was searched.
        evidence: Name of further evidence to its value.
        leader: What a dynamic object goes along with that is not dynamic by its own evidence.
    """

    verdict: Verdict
    num_points: int = 0
    size_m: float = 0.0
    sweeps: Sequence[SweepTerms] = ()
    start: NDArray[np.float64] | None = None
    motion: NDArray[np.float64] | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)
    leader: Leader | None = None


@dataclass(frozen=True, eq=False)
class FlowEstimate:
    """The flow of the current sweep of a triplet.

    Attributes:
        flow: (N, 3) float32, metres until the next sweep, one row for each point of the current
            sweep, in its order. point + flow is the position of the same surface in the
            next sweep's own coordinates: the flow includes the ego motion.
        kept: (N,) bool, the points that the fields were fitted to; the others (ground, beyond
            the crop) have the flow of the same fields, or of the ego motion.
        times_ms: Stage to wall time: prepare, forward, backward, fusion and others.
        fits: Stage to result of its optimization, for forward, backward and fusion.
        start: Whether it went on from the last triplet, or why not.
        device: `cpu` or `cuda`.
        distance_kind: `grid`, `bricks`, `cells` or `tree`; empty for methods that have none.
        precision: Of the products between hidden layers, `float32` or `bfloat16`; empty for methods
            that have none.
        over_ground: Motion without the ego motion, of methods that estimate it.
        num_left_out: Suspects beyond the limit of the settings, which count as static.
        own_body: (B, 3) float32, metres, sensor frame, the points on the robot's own body; their
            flow is 0.
        effort: How much of it was done.
        reason_of: The reason for the rows (M,) of one object, of methods with objects.
    """

    flow: NDArray[np.float32] = field(repr=False)
    kept: NDArray[np.bool_] = field(repr=False)
    times_ms: dict[str, float] = field(default_factory=dict)
    fits: dict[str, OptimizationResult] = field(default_factory=dict)
    start: Start = Start.COLD_BY_SETTING
    device: str = "cpu"
    distance_kind: str = ""
    precision: str = ""
    over_ground: OverGround | None = None
    num_left_out: int = 0
    own_body: NDArray[np.float32] = field(
        default_factory=lambda: np.zeros((0, 3), np.float32), repr=False
    )
    effort: Effort = Effort.FULL
    reason_of: Callable[[NDArray[np.int64]], Reason] | None = field(default=None, repr=False)

    def part(self, rows: NDArray[np.int64]) -> "FlowEstimate":
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
    def own_body_text(self) -> str:
        """Number and reach of the points on the own body."""
        reach_m = np.linalg.norm(self.own_body, axis=1).max(initial=0.0)
        return f"{len(self.own_body)} points" + (f" within {reach_m:.1f} m" if reach_m else "")

    @property
    def stop_reasons(self) -> dict[str, str]:
        """Stage to the reason why its optimization ended."""
        return {stage: fit.stop_reason.value for stage, fit in self.fits.items()}


def check_cancelled(cancelled: Callable[[], bool]) -> None:
    """Ends an estimate if its caller asked for it.

    Raises:
        CancelledError: If `cancelled` returns True.
    """
    if cancelled():
        raise CancelledError("the estimate was cancelled")


@dataclass
class StageClock:
    """Measures the stages of an estimate, and ends it before one if the caller asked for it.

    Attributes:
        cancelled: Asked before each stage.
        finish: Called at the end of each stage, to wait for a GPU.
        times_ms: Stage to wall time.
    """

    cancelled: Callable[[], bool] = lambda: False
    finish: Callable[[], None] = lambda: None
    times_ms: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to the stage's time.

        Raises:
            CancelledError: If `cancelled` returns True.
        """
        check_cancelled(self.cancelled)
        start = time.perf_counter()
        yield
        self.finish()
        elapsed_ms = (time.perf_counter() - start) * 1e3
        self.times_ms[name] = self.times_ms.get(name, 0.0) + elapsed_ms
