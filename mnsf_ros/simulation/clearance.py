"""Keeping moving things apart: a trip is accepted only if it never meets an accepted one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mnsf_ros.geometry.transforms import FloatArray
    from mnsf_ros.simulation.routes import Trip


@dataclass(frozen=True)
class _Track:
    """Discs that cover a footprint over time.

    Attributes:
        centers: (T, K, 2) disc centers in world metres.
        radius_m: Radius of the discs.
        low: (2,) smallest x and y ever covered.
        high: (2,) largest x and y ever covered.
    """

    centers: FloatArray
    radius_m: float
    low: FloatArray
    high: FloatArray


class Clearance:
    """The trips accepted so far, sampled at fixed times."""

    def __init__(self, end_s: float, *, margin_m: float = 0.05, step_s: float = 0.1) -> None:
        """Watch over times from 0 to `end_s`; each thing keeps `margin_m` around itself."""
        self._times_s = np.arange(0.0, end_s + step_s, step_s)
        self._margin_m = margin_m
        self._tracks: list[_Track] = []

    def accept(self, trip: Trip, length_m: float, width_m: float) -> bool:
        """Add the trip of a rectangle of this size unless it meets an accepted one.

        Returns:
            Whether the trip was added.
        """
        track = self._track(trip, length_m, width_m)
        if any(_meet(track, other) for other in self._tracks):
            return False
        self._tracks.append(track)
        return True

    def _track(self, trip: Trip, length_m: float, width_m: float) -> _Track:
        count = max(1, math.ceil(length_m / width_m))
        spacing = length_m / count
        radius = math.hypot(spacing, width_m) / 2 + self._margin_m
        offsets = (np.arange(count) + 0.5) * spacing - length_m / 2
        planar = trip.planar(self._times_s)
        ahead = np.stack([np.cos(planar[:, 2]), np.sin(planar[:, 2])], axis=1)
        centers = planar[:, None, :2] + offsets[None, :, None] * ahead[:, None, :]
        low = centers.min(axis=(0, 1)) - radius
        return _Track(centers, radius, low, centers.max(axis=(0, 1)) + radius)


def _meet(one: _Track, other: _Track) -> bool:
    if np.any(one.low > other.high) or np.any(other.low > one.high):
        return False
    apart = one.centers[:, :, None, :] - other.centers[:, None, :, :]
    nearest = np.min(np.einsum("tijk,tijk->tij", apart, apart))
    return bool(nearest < (one.radius_m + other.radius_m) ** 2)
