# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A lidar: its beams, the pattern and the times of its rays, and its errors."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Bools, Floats
from mnsf_ros.simulation.lidar import Rays
from mnsf_ros.simulation.settings import SimulationSettings, drawn

_LIDARS: Final = {"16": 0.2, "32": 0.2, "64": 0.2, "128": 0.2, "raster": 0.1, "rosette": 0.1}
_COLUMNS: Final = {900: 0.3, 1024: 0.3, 1800: 0.4}
_TOP_DEG, _KNEE_DEG, _BOTTOM_DEG = 2.0, -8.33, -24.8
# A rolling sweep has this many moments of measurement: every 7 degrees of a whole turn.
_NUM_MOMENTS: Final = 50
# Each moment of a rosette sees the whole view, which takes longer to cast.
_ROSETTE_MOMENTS: Final = 10
_TURN_DEG: Final = 360.0
# Turns of a rosette in a sweep, and petals; no whole numbers, so that no sweep repeats another.
_ROSETTE_TURNS, _ROSETTE_PETALS = 37.618, 161.803
_FARTHEST_DROP_M = 8.0
# Share of the rays that a drop returns, for each share of light that is lost per metre.
_DROPS_PER_LOSS = 0.5


@dataclass(frozen=True, eq=False)
class Sensor:
    """Properties of a lidar."""

    kind: str  # name: number of beams, or `solid state`
    elevations_deg: AnyFloats  # (B,) of its beams, increasing; of a rosette its limits
    num_columns: int  # azimuth steps of 360 degrees; of a rosette the points of a sweep
    rate_hz: float  # sweeps per second
    range_noise_m: float  # standard deviation
    dropout: float  # share of returns that are dropped
    max_range_m: float
    # Azimuth of a sweep. Above 360 it is cut by time, and a part is measured twice; below, the
    # lidar does not turn and looks ahead.
    degrees: float = _TURN_DEG
    is_rolling: bool = False  # each point has its own time; else a sweep is taken in an instant
    is_rosette: bool = False  # one beam draws a rosette, another one in each sweep
    rain_per_m: float = 0.0  # share of the light lost to rain; drops near the lidar give points
    min_range_m: float = 0.9
    jitter: float = 0.0  # largest deviation of a sweep's time, in intervals
    missing: float = 0.0  # share of the sweeps that are missing
    # Range at which half of the rays to a surface that returns a tenth come back; all rays to all
    # surfaces if infinite.
    reach_m: float = math.inf
    fog_per_m: float = 0.0  # share of the light lost to fog, if the reach is finite
    # Whether each sweep measures in the same directions, as where an encoder starts the turn.
    is_fixed: bool = False

    def sweep_times(
        self, number: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.intp], AnyFloats]:
        """Returns which of `number` turns give a sweep (T,), and their times in seconds."""
        is_missing, off = rng.uniform(size=(number, 2)).T
        times_s = (np.arange(number) + self.jitter * (2 * off - 1)) * (1.0 / self.rate_hz)
        turns = np.flatnonzero(is_missing >= self.missing)
        return turns, times_s[turns]

    def rays(self, index: int, phase: float) -> Iterator[tuple[Rays, float]]:
        """Yields the rays sent at one time, and the seconds from the stamp until then.

        Most lidars do not start each turn at the same angle: the columns of sweep `index` begin
        `phase` (0 to 1) of a step behind the start, unless the directions are fixed.
        """
        phase = 0.0 if self.is_fixed else phase
        num_columns = round(self.num_columns * (1.0 if self.is_rosette else self.degrees / 360))
        num_moments = _NUM_MOMENTS if self.is_rolling else 1
        if self.is_rosette:
            num_moments = min(num_moments, _ROSETTE_MOMENTS)
        edges = np.linspace(0, num_columns, num_moments + 1).round().astype(int).tolist()
        for begin, end in pairwise(edges):
            rays = (
                self._rosette(index + np.arange(begin, end) / num_columns)
                if self.is_rosette
                else self._sector(self._start(index, num_columns, end), end - begin, phase)
            )
            share = (begin + end) / 2 / num_columns if self.is_rolling else 0.0
            yield rays, share / self.rate_hz

    def _start(self, index: int, num_columns: int, end: int) -> float:
        """Azimuth, radians, of the leftmost column before column `end` of a sweep."""
        if not self.is_rolling:
            return -math.radians(min(self.degrees, _TURN_DEG) / 2)
        # The lidar turns to the right, so the last column of a part is the leftmost of it.
        first = index * num_columns if self.degrees >= _TURN_DEG else -num_columns // 2
        return -(first + end) % self.num_columns * 2 * math.pi / self.num_columns

    def _sector(self, start: float, num_columns: int, phase: float) -> Rays:
        step = 2 * math.pi / self.num_columns
        azimuth = start + (np.arange(num_columns) + phase) * step
        return Rays(azimuth, np.radians(self.elevations_deg)[None])

    def _rosette(self, turns: Floats) -> Rays:
        """The rays of a beam at some times (C,), counted in sweeps."""
        low, high = np.radians(self.elevations_deg[[0, -1]])
        radius = np.sin(2 * math.pi * _ROSETTE_PETALS * turns)
        angle = 2 * math.pi * _ROSETTE_TURNS * turns
        if self.degrees >= _TURN_DEG:
            azimuth, height = np.angle(np.exp(1j * angle)), radius
        else:
            azimuth = math.radians(self.degrees / 2) * radius * np.cos(angle)
            height = radius * np.sin(angle)
        elevation = (low + high) / 2 + (high - low) / 2 * height
        order = np.argsort(azimuth)
        return Rays(azimuth[order], elevation[order, None])

    def add_rain(self, ranges: AnyFloats, rng: np.random.Generator) -> Bools:
        """Removes returns and adds drops near the lidar, in place; returns the mask of surfaces."""
        # There and back again.
        is_lost = rng.uniform(size=len(ranges)) < 1.0 - np.exp(-2.0 * self.rain_per_m * ranges)
        ranges[is_lost] = np.inf
        drops_m = rng.uniform(self.min_range_m, _FARTHEST_DROP_M, len(ranges))
        is_drop = rng.uniform(size=len(ranges)) < _DROPS_PER_LOSS * self.rain_per_m
        is_drop &= drops_m < ranges
        ranges[is_drop] = drops_m[is_drop]
        return ~is_drop


def sensor_of(settings: SimulationSettings) -> Sensor:
    """Returns the lidar of the settings, with beams as in a common 64-beam sensor."""
    return Sensor(
        f"{settings.num_beams} beams",
        knee_elevations_deg(settings.num_beams),
        settings.num_columns,
        settings.rate_hz,
        range_noise_m=0.02,
        dropout=0.02,
        max_range_m=120.0,
    )


def knee_elevations_deg(num_beams: int) -> AnyFloats:
    """Returns (B,) elevations; as in a common 64-beam sensor the upper half is packed densely."""
    half = num_beams // 2
    step = (_KNEE_DEG - _BOTTOM_DEG) / half
    lower = np.linspace(_BOTTOM_DEG, _KNEE_DEG - step, half)
    return np.concatenate([lower, np.linspace(_KNEE_DEG, _TOP_DEG, num_beams - half)])


def drawn_sensor(rng: np.random.Generator) -> Sensor:
    """Returns the lidar of a random world."""
    kind = drawn(_LIDARS, rng)
    sensor = Sensor(
        kind=f"{kind} beams" if kind.isdigit() else "solid state",
        elevations_deg=_elevations_deg(kind, rng),
        num_columns=drawn(_COLUMNS, rng),
        rate_hz=drawn({10.0: 0.75, 20.0: 0.25}, rng),
        range_noise_m=rng.uniform(0.005, 0.03),
        dropout=rng.uniform(0.0, 0.15),
        max_range_m=rng.uniform(70.0, 200.0),
        is_rolling=bool(rng.uniform() < 0.5),
        rain_per_m=drawn({0.0: 0.85, rng.uniform(0.002, 0.012): 0.15}, rng),
    )
    if kind == "raster":
        return replace(sensor, num_columns=1800, degrees=rng.uniform(100.0, 130.0))
    if kind == "rosette":
        num_points, degrees = int(rng.integers(20_000, 48_000)), rng.uniform(70.0, 120.0)
        rosette = replace(sensor, num_columns=num_points, is_rolling=True, is_rosette=True)
        return replace(rosette, degrees=degrees)
    degrees = drawn({360.0: 0.8, 395.0: 0.2}, rng) if sensor.is_rolling else 360.0
    return replace(sensor, degrees=degrees)


def _elevations_deg(kind: str, rng: np.random.Generator) -> AnyFloats:
    """Elevations from low to high, even or denser at the horizon, each a little off."""
    if kind in ("raster", "rosette"):
        low, high, number = -rng.uniform(10.0, 20.0), rng.uniform(8.0, 20.0), 110
    else:
        low, high, number = -rng.uniform(14.0, 31.0), rng.uniform(2.0, 22.0), int(kind)
    shares = np.linspace(-1.0, 1.0, number)
    if rng.uniform() < 0.5:
        elevations = low + (high - low) * (shares + 1) / 2
    else:
        elevations = np.abs(shares) ** rng.uniform(1.2, 2.2) * np.where(shares < 0, low, high)
    return np.sort(elevations + rng.normal(0.0, 0.04, number))
