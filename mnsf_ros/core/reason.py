"""Why something was called dynamic or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray


class Verdict(Enum):
    """What became of an object, step by step: each is the end of the way for those it is of."""

    NO_OBJECT = "ground, or outside the crop"
    TOO_FEW_POINTS = "too few points"
    TOO_LARGE = "too large"
    NOT_SUSPECTED = "not suspected: other sweeps show it at the same place"
    LEFT_OUT = "left out: other suspects are nearer"
    REFUSED = "refused by the gate"
    DYNAMIC = "dynamic"


@dataclass(frozen=True, eq=False)
class Reason:
    """Why an object was called dynamic or not. K is the number of other sweeps.

    Attributes:
        verdict: What became of it.
        num_points: Its points after thinning.
        size_m: The longer horizontal side of the box around it.
        static_m: (K,) metres, what other sweeps leave unexplained if it is static: the next one,
            the previous one, older ones. Empty for what was not suspected.
        moving_m: (K,) metres, the same if it moves; empty if no motion was searched.
        start: (3,) metres over ground until the next sweep, where the fit of its motion started.
        motion: (3,) metres, likewise, the motion that was found; None if none was searched.
        evidence: Name of what else was looked at, to its value.
    """

    verdict: Verdict
    num_points: int = 0
    size_m: float = 0.0
    static_m: tuple[float, ...] = ()
    moving_m: tuple[float, ...] = ()
    start: NDArray[np.float64] | None = None
    motion: NDArray[np.float64] | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)
