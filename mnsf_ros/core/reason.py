# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Why an object was called dynamic or not: what each other sweep says about it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats, Floats32


class Verdict(Enum):
    """Outcome for an object: the stage that decided."""

    OPEN = "not decided yet"
    GROUND = "ground"
    CEILING = "ceiling"
    TOO_HIGH = "too high above the ground"
    OUTSIDE_CROP = "outside the crop"
    NO_OBJECT = "seen a second time in the same revolution"
    OWN_BODY = "the robot's own body"
    EGO_MOTION_LOST = "the ego motion is lost: nothing counts as moving"
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

    positions: Floats32
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
    points: Floats32
    static: Match
    moving: Match | None


class Leader(NamedTuple):
    """The object that another one goes along with, because they touch and move alike.

    Attributes:
        place: (3,) metres, the middle of its points, sensor frame.
        probability: How likely it moves.
    """

    place: Floats32
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
    start: Floats | None = None
    motion: Floats | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)
    leader: Leader | None = None
