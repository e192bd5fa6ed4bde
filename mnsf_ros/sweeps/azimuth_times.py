# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of points that have none: by the direction in which a turning lidar looks."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Of a turn: sweeps have gaps, and some rows begin a little before others.
_MIN_TURN: Final = 0.8
_MAX_TURN: Final = 1.5


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


def times_in_order(xyz: NDArray[np.float32], interval_s: float) -> NDArray[np.float32] | None:
    """Returns (N,) seconds from the middle of a sweep whose points (N, 3) are in order of azimuth.

    The points go around once, or once for each beam; otherwise the result is None.
    """
    if len(xyz) == 0:
        return None
    turns = np.arctan2(xyz[:, 1], xyz[:, 0]) / np.float32(2 * np.pi)
    steps = np.diff(turns, prepend=turns[:1])
    turns = np.cumsum(steps - np.round(steps), dtype=np.float64)
    if abs(turns[-1]) < _MIN_TURN:
        return None
    shares = turns * np.sign(turns[-1])
    if shares[-1] > _MAX_TURN:
        shares %= 1.0
    return (interval_s * (shares - 0.5)).astype(np.float32)
