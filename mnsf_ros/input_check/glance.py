# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a few points tell of each cloud: how many there are, in which directions, how far away."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.sweeps.sweep import NUM_SOME, Sweep

NUM_SIDES: Final = 24
NEAR_M: Final = 4.0
NUM_FIFTHS: Final = 5
_FIFTHS: Final = np.arange(NUM_FIFTHS) * NUM_SOME // NUM_FIFTHS  # where they begin
_SIZES: Final = np.diff(_FIFTHS, append=NUM_SOME)
_FEW: Final = 5  # points of a side, whose mean range tells little
# A point may be at the lens, or beyond all that can be squared.
_LEAST_M2: Final = np.float32(1e-12)
_MOST_M2: Final = np.float32(1e30)


@dataclass(frozen=True, eq=False)
class Glance:
    """A look at the some 500 points that the fingerprint is of: it costs 20 us.

    Attributes:
        num_points: Of the whole cloud.
        num_by_side: (24,) points of the whole cloud, about, in each 15 degrees of azimuth.
        log_ranges: (5,) mean logarithm of the range from the lens, of each fifth of the points,
            the nearest ones first.
        log_by_side: (24,) mean logarithm of the range on each side; NaN for few points.
        near_share: Share of the points within 4 m of the lens.
    """

    num_points: int
    num_by_side: Floats
    log_ranges: Floats
    log_by_side: Floats
    near_share: float

    @classmethod
    def of(cls, sweep: Sweep, lens_m: Floats) -> "Glance | None":
        """Looks at a cloud whose lens is at (3,) metres; None without points."""
        if len(sweep) == 0:
            return None
        xyz = sweep.some_xyz - lens_m.astype(np.float32)
        turns = np.arctan2(xyz[:, 1], xyz[:, 0]) * np.float32(NUM_SIDES / (2 * np.pi))
        # From -12 to 12: the sides behind the lidar are the last ones.
        sides = (turns + np.float32(2 * NUM_SIDES)).astype(np.int64) - NUM_SIDES
        counts = np.bincount(sides, minlength=2 * NUM_SIDES)
        both = (counts[:NUM_SIDES] + counts[NUM_SIDES:]).astype(np.float64)
        squares = np.maximum(np.einsum("ij,ij->i", xyz, xyz), _LEAST_M2)
        ranges = np.log(np.minimum(squares, _MOST_M2)) / 2
        logs_by_side = np.bincount(sides % NUM_SIDES, ranges, NUM_SIDES)
        logs_by_side[both < _FEW] = np.nan
        squares.sort()
        near_share = int(squares.searchsorted(np.float32(NEAR_M**2))) / NUM_SOME
        logs = np.log(np.minimum(squares, _MOST_M2)) / 2
        sums = np.add.reduceat(logs, _FIFTHS).astype(np.float64)
        return cls(
            len(sweep),
            both * (len(sweep) / NUM_SOME),
            sums / _SIZES,
            logs_by_side / np.maximum(both, 1),
            near_share,
        )
