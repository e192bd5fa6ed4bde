# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The result of an estimate: flow, motion over ground, objects and timings."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints, Ints32
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
    center: Floats = field(repr=False)
    size: Floats = field(repr=False)
    yaw: float
    velocity: Floats = field(repr=False)
    turn_rate: float
    covariance: Floats = field(repr=False)
    age_s: float
    num_points: int
    outline: Floats = field(default_factory=lambda: np.empty((0, 2)), repr=False)


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
        lost: Why the ego motion is not known; empty if it is. While it is lost, the confidence is
            0 and nothing counts as dynamic.
    """

    motion: Floats32 = field(repr=False)
    dynamic: Bools = field(repr=False)
    confidence: Floats32 = field(repr=False)
    world_from_sensor: Floats = field(repr=False)
    next_from_current: Floats = field(repr=False)
    source: str
    pose_covariance: Floats | None = field(default=None, repr=False)
    motion_covariance: Floats | None = field(default=None, repr=False)
    objects: tuple[TrackedObject, ...] = ()
    track_ids: Ints32 | None = field(default=None, repr=False)
    lost: str = ""

    def part(self, rows: Ints) -> "OverGround":
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

    flow: Floats32 = field(repr=False)
    kept: Bools = field(repr=False)
    times_ms: dict[str, float] = field(default_factory=dict)
    fits: dict[str, OptimizationResult] = field(default_factory=dict)
    start: Start = Start.COLD_BY_SETTING
    device: str = "cpu"
    distance_kind: str = ""
    precision: str = ""
    over_ground: OverGround | None = None
    num_left_out: int = 0
    own_body: Floats32 = field(default_factory=lambda: np.zeros((0, 3), np.float32), repr=False)
    effort: Effort = Effort.FULL
    reason_of: Callable[[Ints], Reason] | None = field(default=None, repr=False)

    def part(self, rows: Ints) -> "FlowEstimate":
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
