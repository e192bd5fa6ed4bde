"""Errors of points at similar range from the sensor, and of points of similar speed."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.metrics import FlowErrors, flow_errors

# Upper limits; a value on a limit belongs to the band above it.
RANGE_LIMITS_M: Final = (10.0, 20.0, 35.0, 50.0, 80.0, np.inf)
SPEED_LIMITS_M_S: Final = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, np.inf)


def errors_by_band(
    estimate: NDArray[Any],
    truth: NDArray[Any],
    valid: NDArray[np.bool_],
    values: NDArray[np.float64],
    limits: tuple[float, ...],
) -> dict[str, FlowErrors]:
    """Scores the points of each band apart.

    Args:
        estimate: (N, 3) metres per sweep interval.
        truth: (N, 3), same unit, frame and order.
        valid: (N,) bool, the points to score.
        values: (N,) what the bands are bands of, at least 0.
        limits: Upper limits of the bands, ascending, the last one infinite.

    Returns:
        Upper limit as text (`10`, `inf`) to errors; bands without points are missing.
    """
    bands = np.searchsorted(np.asarray(limits), values, side="right")
    return {
        f"{limit:g}": flow_errors(estimate, truth, valid & (bands == number))
        for number, limit in enumerate(limits)
        if (valid & (bands == number)).any()
    }
