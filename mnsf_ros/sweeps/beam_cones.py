# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Lens of a turning lidar: only seen from it, the points of each beam are on a cone."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats, Floats32, Ints
from mnsf_ros.sweeps.range_view import NUM_AZIMUTHS, azimuths_of

_NUM_POINTS: Final = 4096
# The beams of a lidar that does not turn are no cones.
_MIN_AROUND: Final = 0.8
_NUM_SECTORS: Final = 72
# Deviation of beams from their cones: .00 to .03 in five lidars, .2 to .3 with the lens .3 m away.
_MAX_BLUR_DEG: Final = 0.3
_CLEARLY: Final = 0.25
# Where a lens is searched: a robot's frame is on its ground or its rear axle.
_PLACES_M: Final = np.mgrid[-6.0:9.1:1.5, -3.0:3.1:1.5, -1.0:4.1:1.0].reshape(3, -1).T
_NUM_FEW: Final = 512
_NUM_STARTS: Final = 3
_NUM_STEPS: Final = 15
# Deviations above this count by their distance, not by its square.
_FAR_M: Final = 0.05


class BeamCones(NamedTuple):
    """Deviation of beams from cones with a common axis.

    Attributes:
        num_beams: Number of beams.
        blur_deg: Mean deviation from cones around the origin of the frame.
        lens_m: (3,) the place from which they are cones; None if they are at the origin, or from
            nowhere.
    """

    num_beams: int
    blur_deg: float
    lens_m: Floats | None

    @classmethod
    def of(cls, xyz: Floats32, rings: NDArray[np.integer[Any]]) -> "BeamCones | None":
        """Returns the cones of points (N, 3), metres, with the numbers of their beams (N,).

        None for few points, and for a lidar that does not turn.
        """
        rows = np.random.default_rng(0).permutation(len(xyz))[:_NUM_POINTS]
        points, beams = xyz[rows].astype(np.float64), _from_zero(rings[rows])
        sectors = azimuths_of(xyz[rows]) * _NUM_SECTORS // NUM_AZIMUTHS
        if len(np.unique(sectors)) < _MIN_AROUND * _NUM_SECTORS:
            return None
        num_beams, blur_deg = int(beams.max()) + 1, _Deviations(points, beams).mean_deg
        if blur_deg < _MAX_BLUR_DEG:
            return cls(num_beams, blur_deg, None)
        lens_m = _lens(points, beams)
        is_lens = _Deviations(points - lens_m, beams).mean_deg < _CLEARLY * blur_deg
        return cls(num_beams, blur_deg, lens_m if is_lens else None)


class _Deviations:
    """Deviations of points (K, 3) of beams (K,) from cones around the origin.

    The common axis of the cones is the direction in which the beams vary least.
    """

    def __init__(self, points: Floats, beams: Ints) -> None:
        self._beams = beams
        self._ranges_m = np.maximum(np.linalg.norm(points, axis=1), 1e-6)
        self._rays = points / self._ranges_m[:, None]
        off = _from_mean(self._rays, beams)
        self._axis = np.linalg.eigh(off.T @ off)[1][:, 0]
        self._values = off @ self._axis
        self._off_m = np.abs(self._values) * self._ranges_m

    @property
    def mean_deg(self) -> float:
        return float(np.degrees(np.mean(np.abs(self._values))))

    @property
    def mean_m(self) -> float:
        return float(np.mean(self._off_m))

    def step(self, *, is_coarse: bool) -> Floats:
        """(3,) metres to where they are less.

        Near points, as of the roof, are far off until the place is right: a coarse step weighs
        distances, a fine one the squares of angles.
        """
        along = (self._rays @ self._axis)[:, None] * self._rays
        change = _from_mean((along - self._axis) / self._ranges_m[:, None], self._beams)
        weights = np.ones(len(change))
        if is_coarse:
            weights = self._ranges_m / np.sqrt(self._off_m + _FAR_M)
        found = np.linalg.lstsq(weights[:, None] * change, -weights * self._values, rcond=None)[0]
        return np.asarray(found / max(1.0, float(np.linalg.norm(found))))


def _lens(points: Floats, beams: Ints) -> Floats:
    """(3,) metres, the place from which points (K, 3) deviate least."""
    few, own = points[:_NUM_FEW], _from_zero(beams[:_NUM_FEW])
    starts = sorted(_PLACES_M, key=lambda place: _Deviations(few - place, own).mean_m)
    found = []
    for start in starts[:_NUM_STARTS]:
        place = start.copy()
        for number in range(2 * _NUM_STEPS):
            deviations = _Deviations(points - place, beams)
            place += deviations.step(is_coarse=number < _NUM_STEPS)
        found.append(place)
    return min(found, key=lambda place: _Deviations(points - place, beams).mean_m)


def _from_zero(rings: NDArray[np.integer[Any]]) -> Ints:
    return np.unique(rings, return_inverse=True)[1].reshape(-1)


def _from_mean(values: Floats, beams: Ints) -> Floats:
    """Values (K, 3) less the mean of their beam."""
    counts = np.bincount(beams)
    means = np.stack([np.bincount(beams, values[:, axis]) / counts for axis in range(3)], axis=1)
    return np.asarray(values - means[beams])
