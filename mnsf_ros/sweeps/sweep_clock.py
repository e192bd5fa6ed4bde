# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Measuring time of each direction of a turning lidar, and the overlap at its seam."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import minimum_filter1d

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints, Ints32
from mnsf_ros.geometry.point_grid import PointGrid
from mnsf_ros.sweeps.range_view import NUM_AZIMUTHS, azimuths_of, in_axes_of_beams
from mnsf_ros.sweeps.sweep import NOT_TILTED

# A lidar turns if the points of one direction are measured at about the same time: the mean
# deviation as a share of the sweep.
_MAX_SPREAD: Final = 0.05
# After lost packets some times are too early. Those of up to this share of the points of an azimuth
# count as such, unless the lidar measured so early within 5 degrees beside it, as at the seam.
_FEW: Final = 0.1
_BESIDE: Final = NUM_AZIMUTHS * 5 // 360
_NUM_PARTS: Final = 64  # of the sweep, in which times are counted


@dataclass(frozen=True, eq=False)
class SweepClock:
    """The times of a sweep of a turning lidar.

    Attributes:
        times_s: (720,) float64, seconds from the stamp to when each azimuth was first measured.
        is_again: (N,) bool, the points that were measured after a full revolution.
        revolution_s: Seconds from the first to the second view of a point.
        beams_from_sensor: (3, 3) rotation to the axes in which azimuths are.
    """

    times_s: Floats
    is_again: Bools
    revolution_s: float
    beams_from_sensor: Floats

    @classmethod
    def of(
        cls, xyz: Floats32, times_s: Floats32, beams_from_sensor: Floats = NOT_TILTED
    ) -> "SweepClock | None":
        """Returns the clock of points (N, 3), metres, with times (N,), of beams at (3, 3).

        None if nothing turns, and for the merged cloud of several lidars: their sweeps are no
        second views of each other.
        """
        if len(xyz) == 0:
            return None
        cells = azimuths_of(in_axes_of_beams(xyz, beams_from_sensor))
        span_s = float(times_s.max()) - float(times_s.min())
        first: Floats32 = np.full(NUM_AZIMUTHS, np.inf, np.float32)
        np.minimum.at(first, cells, times_s)
        first = np.maximum(first, _usual_first(cells, times_s))
        # What was measured later by half of the sweep is a second view.
        is_again = times_s > first[cells] + np.float32(span_s / 2)
        is_own = ~is_again & (times_s >= first[cells])
        own_cells, own_s = cells[is_own], times_s[is_own]
        counts = np.bincount(own_cells, minlength=NUM_AZIMUTHS)
        means = np.bincount(own_cells, own_s, NUM_AZIMUTHS) / np.maximum(counts, 1)
        if np.abs(own_s - means[own_cells]).mean() > _MAX_SPREAD * span_s:
            return None
        num_again = np.count_nonzero(np.bincount(cells[is_again], minlength=NUM_AZIMUTHS))
        # One lidar sees few directions again; several in one cloud see all of them.
        if 2 * num_again > np.count_nonzero(counts):
            return None
        revolution_s = 0.0
        if is_again.any():
            revolution_s = float(np.median(times_s[is_again] - means[cells[is_again]]))
        times_by_azimuth_s = means[_nearest_filled(counts > 0)]
        return cls(times_by_azimuth_s, is_again, revolution_s, beams_from_sensor)

    def times_of(self, positions: Floats32) -> Floats:
        """Returns (P,) seconds from the stamp to when places (P, 3) were measured first."""
        return self.times_s[azimuths_of(in_axes_of_beams(positions, self.beams_from_sensor))]

    def owners_again(
        self, xyz: Floats32, points: Floats32, velocities: Floats32, rows: Ints
    ) -> tuple[Ints, Ints]:
        """Returns (M,) the points that were seen again of movers, and (M,) which mover each is of.

        Args:
            xyz: (N, 3) metres, the points of the sweep.
            points: (P, 3) metres, points of movers when they were seen first.
            velocities: (P, 3) metres per second.
            rows: (P,) the movers.
        """
        again = np.flatnonzero(self.is_again)
        if len(again) == 0 or len(points) == 0:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        moved = points + np.float32(self.revolution_s) * velocities
        nearest = PointGrid(moved).nearest(xyz[again])
        is_near = nearest >= 0
        return again[is_near], rows[nearest[is_near]]


def _usual_first(cells: Ints32, times_s: Floats32) -> Floats32:
    """Returns (720,) when the first points were measured around each azimuth, but for a few."""
    start_s, span_s = float(times_s.min()), float(np.ptp(times_s))
    parts = (times_s - start_s) * np.float32(_NUM_PARTS / (span_s or 1.0))
    keys = cells * (_NUM_PARTS + 1) + parts.astype(np.int64)
    counts = np.bincount(keys, minlength=NUM_AZIMUTHS * (_NUM_PARTS + 1))
    sums = counts.reshape(NUM_AZIMUTHS, -1).cumsum(axis=1)
    first = np.count_nonzero(sums <= _FEW * sums[:, -1:], axis=1)
    earliest = minimum_filter1d(first, 2 * _BESIDE + 1, mode="wrap")
    return (start_s + earliest * (span_s / _NUM_PARTS)).astype(np.float32)


def _nearest_filled(is_filled: Bools) -> Ints:
    """Returns (720,) the nearest azimuth that has points."""
    filled, azimuths = np.flatnonzero(is_filled), np.arange(NUM_AZIMUTHS)
    around = np.concatenate([filled + turn * NUM_AZIMUTHS for turn in (-1, 0, 1)])
    place = np.searchsorted(around, azimuths)
    before, after = around[place - 1], around[place]
    return np.where(after - azimuths < azimuths - before, after, before) % NUM_AZIMUTHS
