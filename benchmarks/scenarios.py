# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated streets of the benchmarks: those of `mnsf simulate`, and one for each rule."""

from __future__ import annotations

from typing import Final

import numpy as np

from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.bodies import Model, box
from mnsf_ros.simulation.scenarios import (
    BACK,
    BESIDE,
    HOUSES,
    POSTS,
    STAGES,
    STREET,
    Mover,
    Row,
    Sensor,
    Stage,
    across,
    along,
    walk,
)


def bus_front(rng: np.random.Generator) -> Model:
    """Returns the front part of an articulated bus; its end, at the joint, is nobody's alone."""
    roof, reflectivity = rng.uniform(2.9, 3.1), rng.uniform(60.0, 120.0)
    shapes = (box((-4.4, 4.4), (-1.25, 1.25), (0.3, roof)),)
    return Model(SurfaceClass.LARGE_VEHICLE, shapes, 7.2, 2.5, reflectivity)


def bus_rear(rng: np.random.Generator) -> Model:
    """Returns the rear part of an articulated bus, which follows 9 m behind the front part."""
    roof, reflectivity = rng.uniform(2.9, 3.1), rng.uniform(60.0, 120.0)
    shapes = (box((-4.2, 4.2), (-1.25, 1.25), (0.3, roof)),)
    return Model(SurfaceClass.LARGE_VEHICLE, shapes, 7.2, 2.5, reflectivity)


def coach(rng: np.random.Generator) -> Model:
    """Returns a coach of 17 m in one piece: longer than what usually moves."""
    roof, reflectivity = rng.uniform(3.2, 3.6), rng.uniform(60.0, 120.0)
    shapes = (box((-8.5, 8.5), (-1.27, 1.27), (0.35, roof)),)
    return Model(SurfaceClass.LARGE_VEHICLE, shapes, 17.0, 2.54, reflectivity)


_TRAFFIC: Final = (*BESIDE, Mover("car", along(-2.0), 8.0, 76.0, 2, 31.0))

# None is the usual street, which is drawn from the seed.
SCENARIOS: Final[dict[str, Stage | None]] = {
    "street": None,
    **STAGES,
    "walkers": Stage(
        "people along walls, and out from between parked cars",
        (
            *(Mover("pedestrian", along(y), 1.0 + 0.12 * n, 66.0 + 9.0 * n)
              for n in range(8) for y in (10.3, -10.3)),
            *(Mover("pedestrian", along(y, BACK), 1.2, 290.0 - 13.0 * n)
              for n in range(5) for y in (9.5, -9.5)),
            *(Mover("pedestrian", across(x, 8.0 * side, 4.2 * side), walk(time, 3.8, 1.6))
              for x, time in ((20.0, 0.4), (32.8, 1.6), (52.0, 3.8), (64.8, 5.4), (84.0, 7.6))
              for side in (1.0, -1.0)),
        ),
        STREET,
    ),
    "slow_walkers": Stage(
        "people who walk at 0.3 to 1 m/s",
        (
            *(Mover("pedestrian", along(y), 0.3 + 0.1 * n, 66.0 + 4.5 * n)
              for n in range(8) for y in (8.6, -10.2)),
            *(Mover("pedestrian", across(x, -7.8, 7.8), speed, 1.0)
              for x, speed in ((28.0, 0.3), (31.5, 0.5), (35.0, 0.7), (38.5, 0.9))),
        ),
        (*HOUSES, *POSTS),
        ego_speeds=((0.0, 0.25),),
    ),
    "scooters": Stage(
        "scooters that overtake on both sides at 11 to 13 m/s",
        (
            Mover("scooter", along(-3.7), 11.0, 66.0, 5, 14.0),
            Mover("scooter", along(-0.2), 13.0, 58.0, 5, 17.0),
            Mover("scooter", along(3.7, BACK), 12.0, 210.0, 5, -25.0),
            Mover("car", along(-2.0), 8.0, 78.0),
            Mover("car", along(2.0, BACK), 8.0, 170.0, 6, -18.0),
        ),
        STREET,
    ),
    "stop_and_go": Stage(
        "cars, scooters and people that start and stop",
        (
            Mover("car", along(-2.0), ((1.0, 8.0), (3.0, 0.0), (4.5, 0.0), (6.5, 8.0)), 83.0),
            Mover("car", along(2.0, BACK), ((0.5, 8.0), (2.5, 0.0), (5.0, 0.0), (7.5, 8.0)),
                  240.0),
            Mover("van", along(2.0, BACK), ((1.0, 8.0), (3.2, 0.0), (5.5, 0.0), (8.0, 8.0)),
                  229.0),
            Mover("scooter", along(-3.7), ((1.0, 9.0), (2.5, 0.0), (5.0, 0.0), (6.0, 10.0)), 74.0),
            *(Mover("pedestrian", along(y), walk(begin, 3.0, 1.4), 70.0 + 8.0 * n)
              for n, begin in enumerate((0.5, 1.5, 3.0, 5.0, 6.5)) for y in (8.8, -9.4)),
        ),
        STREET,
        ego_speeds=((1.0, 1.0), (3.0, 0.0), (4.8, 0.0), (6.8, 1.0)),
    ),
    "bus": Stage(
        "articulated buses that turn at a crossing",
        (
            *(Mover(part, ((120.0, 2.0), (32.0, 2.0), (32.0, 90.0)), 5.0, at, radius_m=9.0)
              for part, at in ((bus_front, 72.0), (bus_rear, 63.0))),
            *(Mover(part, ((32.0, -90.0), (32.0, 2.0), (-90.0, 2.0)), 6.0, at, radius_m=9.0)
              for part, at in ((bus_front, 74.0), (bus_rear, 65.0))),
            Mover("pedestrian", along(9.0, BACK), 1.3, 282.0, 5, -7.0),
        ),
        STREET,
        ego_speeds=((0.0, 1.0), (0.5, 1.0), (2.5, 0.0)),
        crossing_x=30.0,
    ),
    "touching": Stage(
        "people and scooters that touch a hedge, coaches of 17 m",
        (
            *(Mover("pedestrian", along(6.85), 0.9 + 0.1 * n, 60.0 + 6.0 * n) for n in range(9)),
            Mover("scooter", along(-6.6), 6.0, 58.0, 4, -12.0),
            Mover(coach, along(2.2, BACK), 8.0, 228.0, 2, -40.0),
        ),
        (*HOUSES, Row("hedge", 7.5, 3.9), Row("hedge", -7.5, 3.9)),
    ),
    "alley": Stage(
        "an alley with shop windows, seen through at some angles",
        (
            Mover("pedestrian", along(2.4), 1.3, 64.0, 6, -7.0),
            Mover("pedestrian", along(-2.5, BACK), 0.9, 232.0, 5, 7.5),
            Mover("cyclist", along(0.9, BACK), 4.0, 205.0, 2, -20.0),
        ),
        (Row("shop", 8.0, 9.0), Row("shop", -8.0, 9.0, 180.0)),
        ego=((-30.0, -0.6), (300.0, -0.6)),
        ego_speeds=((0.0, 0.3),),
        road_half_width_m=100.0,
    ),
    "seam": Stage(
        "sweeps of 395 degrees, cut by time",
        _TRAFFIC,
        STREET,
        sensor=Sensor(is_rolling=True, degrees=395.0),
    ),
    "rain": Stage(
        "rain: lost returns, drops near the lidar, noise",
        _TRAFFIC,
        STREET,
        sensor=Sensor(rain_per_m=0.012),
    ),
}  # fmt: skip
