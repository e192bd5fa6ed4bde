# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Why something was called dynamic or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray


class Verdict(Enum):
    """What became of an object: the step at which it was decided."""

    NO_OBJECT = "ground, or outside the crop"
    TOO_FEW_POINTS = "too few points"
    TOO_LARGE = "too large"
    NOT_SUSPECTED = "not suspected: other sweeps show it at the same place"
    LEFT_OUT = "left out: other suspects are nearer"
    NO_BETTER_MOTION = "no motion explains it better"
    REFUSED = "refused by the gate"
    DYNAMIC = "dynamic"


@dataclass(frozen=True, eq=False)
class Reason:
    """Why an object was called dynamic or not.

    Attributes:
        verdict: What became of it.
        num_points: Its points after thinning.
        size_m: The longer horizontal side of the box around it.
        static_m: Name of another sweep to metres that it leaves unexplained if the object is
            static; empty if no motion was searched.
        moving_m: The same if it moves.
        start: (3,) metres over ground until the next sweep, where the fit of its motion started.
        motion: (3,) metres, likewise, the motion that was found; None if none was searched.
        evidence: Name of what else was looked at, to its value.
    """

    verdict: Verdict
    num_points: int = 0
    size_m: float = 0.0
    static_m: Mapping[str, float] = field(default_factory=dict)
    moving_m: Mapping[str, float] = field(default_factory=dict)
    start: NDArray[np.float64] | None = None
    motion: NDArray[np.float64] | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)
