# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Conditions of adverse worlds: properties of real recordings that random worlds lack.

Each condition has its own random generator.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Final, TypeAlias

import numpy as np

from mnsf_ros.simulation.sensor import Sensor
from mnsf_ros.simulation.settings import CONDITIONS

# Generators of the conditions that a world has.
Draws: TypeAlias = Mapping[str, np.random.Generator]

# Minimum range where the own body is seen: the nearest points of `radiate_hdl32` are at 0.5 m.
_NEAREST_M: Final = 0.5
# From data sheets: beams or limits of the view (degrees), columns of a turn, or points of a sweep
# at 10 Hz, error and range (m). VLP-16: 2 degrees apart, 0.2 degrees a column. HDL-32E: 4/3 degrees
# apart, 695,000 points a second. Mid-360: 200,000 points a second; 40 m where 10 % return.
_REAL: Final = (
    Sensor("16 beams", np.linspace(-15.0, 15.0, 16), 1800, 10.0, 0.03, 0.02, 100.0),
    Sensor("32 beams", np.linspace(-30.67, 10.67, 32), 2170, 10.0, 0.02, 0.02, 100.0),
    Sensor(
        kind="solid state",
        elevations_deg=np.array([-7.0, 52.0]),
        num_columns=20_000,
        rate_hz=10.0,
        range_noise_m=0.02,
        dropout=0.02,
        max_range_m=70.0,
        min_range_m=0.1,
        reach_m=40.0,
        is_rosette=True,
    ),
)


def draws_of(conditions: Collection[str], rng: np.random.Generator) -> Draws:
    """Returns a generator for each condition that a world has."""
    draws = zip(CONDITIONS, rng.spawn(len(CONDITIONS)), strict=True)
    return {name: draw for name, draw in draws if name in conditions}


def sensor_under(sensor: Sensor, draws: Draws) -> Sensor:
    """Returns the lidar of a world with some conditions."""
    if draw := draws.get("lidar"):
        real = _REAL[int(draw.integers(len(_REAL)))]
        sensor = replace(real, is_rolling=True, rain_per_m=sensor.rain_per_m)
    if draw := draws.get("jitter"):
        # KITTI has 103.6 ms between sweeps, Argoverse 2 from 99 to 103.6.
        rate_hz = round(sensor.rate_hz * draw.uniform(0.96, 1.01), 2)
        sensor = replace(sensor, rate_hz=rate_hz, jitter=draw.uniform(0.001, 0.015))
    if draw := draws.get("gaps"):
        sensor = replace(sensor, missing=draw.uniform(0.03, 0.15))
    if "body" in draws:
        sensor = replace(sensor, min_range_m=min(sensor.min_range_m, _NEAREST_M))
    for name in ("walls", "wet", "fog"):
        if (draw := draws.get(name)) and math.isinf(sensor.reach_m):
            sensor = replace(sensor, reach_m=draw.uniform(30.0, 60.0))
    if draw := draws.get("fog"):
        # Koschmieder: in fog of this visibility a contrast of 5 % is left.
        visibility_m = math.exp(draw.uniform(math.log(50.0), math.log(250.0)))
        sensor = replace(sensor, fog_per_m=-math.log(0.05) / visibility_m)
    return sensor


def wetness_under(draws: Draws) -> float:
    """Returns how wet all surfaces are, 0 to 1."""
    return float(draws["wet"].uniform(0.3, 1.0)) if "wet" in draws else 0.0
