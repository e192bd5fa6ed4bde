"""One triplet of a recording, ready to be estimated and scored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.sweeps.sweep import SweepTriplet


@dataclass(frozen=True, eq=False)
class Example:
    """A triplet with what is known about the true flow of its current sweep.

    Attributes:
        recording: Name of the recording.
        number: Place of the current sweep in the recording, in stamp order, counted from 0.
        triplet: The sweeps as every method gets them: finite points, cropped, without ground,
            sampled if a number of points was asked for.
        truth: True flow of the points of the current sweep, row for row; None if unknown.
        next_from_current: (4, 4) rigid motion of the standing world from the current to the next
            sensor frame, from the recording's odometry; None if unknown.
        scored: (N,) bool, the points of the current sweep that figures are taken of, the same for
            all methods; None for all. Where a method prepares sweeps itself, it gets more than
            these.
    """

    recording: str
    number: int
    triplet: SweepTriplet
    truth: FlowTruth | None = None
    next_from_current: NDArray[np.float64] | None = None
    scored: NDArray[np.bool_] | None = None
