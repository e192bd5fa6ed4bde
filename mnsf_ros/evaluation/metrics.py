# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The errors of an estimated flow against pseudo ground truth, as the paper computes them.

The formulas are from the paper's own code, including its edge cases:

* All comparisons are strict: an error of exactly 0.05 m is not within 5 cm.
* The relative error is e / (|truth| + 1e-20). A perfect zero counts as accurate, but a static
  point (zero truth) that is 1 mm off has a huge relative error and *is an outlier*, though its
  5 cm make it accurate. Outliers therefore say little where most of the truth is zero, as in
  flow without the sensor's own motion.
* A vector without direction, on either side, is π/2 away from any other.
* The cosine is kept 1e-7 away from ±1, so even a perfect flow has an angle error of 0.00045.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats

_STRICT: Final = 0.05  # metres, and share of the true length
_RELAXED: Final = 0.10
_OUTLIER_M: Final = 0.30
_OUTLIER_SHARE: Final = 0.10
_TINY_LENGTH_M: Final = 1e-20
_COSINE_MARGIN: Final = 1e-7

# Upper limits; a value on a limit belongs to the band above it.
RANGE_LIMITS_M: Final = (10.0, 20.0, 35.0, 50.0, 80.0, np.inf)
SPEED_LIMITS_M_S: Final = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, np.inf)


@dataclass(frozen=True)
class FlowErrors:
    """The errors of one flow; NaN without points. Shares are 0 to 1."""

    epe_m: float  # mean end point error
    acc5: float  # share of points with an error below 5 cm or 5 % of the true length
    acc10: float  # the same with 10 cm and 10 %
    outliers: float  # share of points with an error above 30 cm or 10 % of the true length
    angle_error_rad: float  # mean angle between the estimated and the true vector
    num_points: int


ERRORS: Final = tuple(field.name for field in fields(FlowErrors))


def flow_errors(estimate: NDArray[Any], truth: NDArray[Any]) -> FlowErrors:
    """Scores an estimated flow (N, 3) against the truth (N, 3), metres per sweep interval."""
    if len(truth) == 0:
        return FlowErrors(math.nan, math.nan, math.nan, math.nan, math.nan, 0)
    errors_m = end_point_errors(estimate, truth)
    relative = errors_m / (_lengths(truth) + _TINY_LENGTH_M)
    return FlowErrors(
        epe_m=float(errors_m.mean()),
        acc5=float(((errors_m < _STRICT) | (relative < _STRICT)).mean()),
        acc10=float(((errors_m < _RELAXED) | (relative < _RELAXED)).mean()),
        outliers=float(((errors_m > _OUTLIER_M) | (relative > _OUTLIER_SHARE)).mean()),
        angle_error_rad=float(_angle_errors(estimate, truth).mean()),
        num_points=len(estimate),
    )


def by_motion(estimate: NDArray[Any], truth: NDArray[Any], dynamic: Bools) -> dict[str, FlowErrors]:
    """Scores `all` points, those that are `dynamic` (N,), and those that are `static`."""
    parts = {"all": np.ones_like(dynamic), "dynamic": dynamic, "static": ~dynamic}
    return {name: flow_errors(estimate[mask], truth[mask]) for name, mask in parts.items()}


def errors_by_band(
    estimate: NDArray[Any], truth: NDArray[Any], values: Floats, limits: tuple[float, ...]
) -> dict[str, FlowErrors]:
    """Scores points in bands of values (N,) from 0 to ascending upper limits, the last infinite.

    Returns:
        Upper limit as text (`10`, `inf`) to errors; bands without points are missing.
    """
    bands = np.searchsorted(np.asarray(limits), values, side="right")
    return {
        f"{limit:g}": flow_errors(estimate[bands == number], truth[bands == number])
        for number, limit in enumerate(limits)
        if (bands == number).any()
    }


def mean(values: Sequence[float]) -> float:
    """Returns the mean of the values that are numbers; NaN if there are none."""
    numbers = [value for value in values if not math.isnan(value)]
    return math.fsum(numbers) / len(numbers) if numbers else math.nan


def end_point_errors(estimate: NDArray[Any], truth: NDArray[Any]) -> Floats:
    """Distance (N,) between estimated and true vectors (N, 3), metres."""
    return _lengths(np.subtract(estimate, truth, dtype=np.float64))


def _angle_errors(estimate: NDArray[Any], truth: NDArray[Any]) -> Floats:
    """Angle (N,) between estimated and true vectors (N, 3), radians; π/2 without direction."""
    with np.errstate(divide="ignore", invalid="ignore"):
        directions = [vectors / _lengths(vectors)[:, None] for vectors in (estimate, truth)]
        cosines = np.prod(directions, axis=0).sum(axis=1)
    cosines = np.clip(cosines, _COSINE_MARGIN - 1.0, 1.0 - _COSINE_MARGIN)
    return np.arccos(np.nan_to_num(cosines, nan=0.0))


def _lengths(vectors: NDArray[Any]) -> Floats:
    return np.linalg.norm(vectors.astype(np.float64), axis=1)
