# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of points that have none: by the direction in which a turning lidar looks."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class AzimuthTimes:
    """How a lidar turns, as seen from above.

    Attributes:
        is_clockwise: Whether it turns clockwise.
        start_deg: Azimuth at which a sweep begins and ends.
    """

    is_clockwise: bool
    start_deg: float

    def of(self, xyz: NDArray[np.float32], interval_s: float) -> NDArray[np.float32]:
        """Returns (N,) seconds from the middle of a sweep to the measurement of points (N, 3)."""
        turns = (np.arctan2(xyz[:, 1], xyz[:, 0]) - np.radians(self.start_deg)) / (2 * np.pi)
        shares = (-turns if self.is_clockwise else turns) % 1.0
        return (interval_s * (shares - 0.5)).astype(np.float32)

    def __str__(self) -> str:
        """Returns the value of the parameter time.field."""
        return f"{'clockwise' if self.is_clockwise else 'counterclockwise'}:{self.start_deg:g}"
