# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Where points are, seen from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled


@compiled("UniTuple(float32, 4)(float32[:, ::1])")
def bounds(xyz: NDArray[np.float32]) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Returns the lowest x and y, and the highest x and y, of points (N, 3) with N > 0."""
    low_x = high_x = xyz[0, 0]
    low_y = high_y = xyz[0, 1]
    # Of a flat array the compiler knows the steps.
    values = xyz.reshape(-1)
    for row in range(len(xyz)):
        x, y = values[3 * row], values[3 * row + 1]
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    return low_x, low_y, high_x, high_y
