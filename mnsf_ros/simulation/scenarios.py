# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The staged scenarios of `mnsf simulate`: static things, movers, and the lidar's properties.

Places are metres in the world: the ego vehicle starts near (0, -2) and looks along +x, y is left.
Speeds are m/s, those of the ego vehicle shares of the setting `ego_speed_m_s`. A model is the name
of a function in `models`, or such a function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

# Time in seconds and speed, linear between.
Speeds = tuple[tuple[float, float], ...]
Way = tuple[tuple[float, float], ...]
ModelName = str | Callable[..., Any]


@dataclass(frozen=True)
class Mover:
    """Things that move along a way, one behind the other.

    Attributes:
        model: Their model.
        way: Corners of the way, rounded by `radius_m`; beyond its ends it goes straight on.
        speeds: One speed, or a profile over time; constant before and after.
        at_m: Distance of the first one along the way at the first time of its profile.
        count: Number of things.
        spacing_m: Distance from each to the one before it.
        radius_m: Radius of the bends.
    """

    model: ModelName
    way: Way
    speeds: float | Speeds
    at_m: float = 0.0
    count: int = 1
    spacing_m: float = 20.0
    radius_m: float = 8.0


@dataclass(frozen=True)
class Row:
    """Static things in a row along x, `pitch_m` apart, each there with the probability `share`."""

    model: ModelName
    y: float
    pitch_m: float
    turn_deg: float = 0.0
    share: float = 1.0
    from_x: float = -60.0
    to_x: float = 200.0


@dataclass(frozen=True)
class Sensor:
    """Properties of the lidar.

    Attributes:
        is_rolling: Whether each point has its own time; else a sweep is taken in an instant.
        degrees: Azimuth of a sweep. Above 360 it is cut by time, and a part is measured twice.
        rain_per_m: Share of the light lost to rain per metre; drops near the lidar give points.
    """

    is_rolling: bool = False
    degrees: float = 360.0
    rain_per_m: float = 0.0


@dataclass(frozen=True)
class Stage:
    """One scenario.

    Attributes:
        text: One line about it.
        movers: The moving things.
        rows: The static things.
        ego: The way of the ego vehicle.
        ego_speeds: Its speeds, as shares of the setting.
        crossing_x: Place of a side street, without rows within 14 m; None if there is none.
        road_half_width_m: Distance from the middle of the road to the sidewalks.
        sensor: Properties of the lidar.
    """

    text: str
    movers: tuple[Mover, ...]
    rows: tuple[Row, ...]
    ego: Way = ((-30.0, -2.0), (300.0, -2.0))
    ego_speeds: Speeds = ((0.0, 1.0),)
    crossing_x: float | None = None
    road_half_width_m: float = 6.5
    sensor: Sensor = Sensor()


HOUSES: Final = (Row("house", 15.7, 11.0), Row("house", -15.7, 11.0, 180.0))
PARKED: Final = (Row("car", 5.4, 6.4, share=0.7), Row("car", -5.4, 6.4, 180.0, share=0.7))
POSTS: Final = (
    *(Row("tree", y, 13.0) for y in (7.3, -7.3)),
    *(Row("lamp_post", y, 26.0, -turn, from_x=-53.0) for y, turn in ((7.3, 90.0), (-7.3, -90.0))),
)
STREET: Final = (*HOUSES, *PARKED, *POSTS)
_FORTH: Final = -60.0, 300.0
BACK: Final = 300.0, -60.0


def along(y: float, x: tuple[float, float] = _FORTH) -> Way:
    """A way along the street, at y."""
    return ((x[0], y), (x[1], y))


def across(x: float, *ys: float) -> Way:
    """A way across the street, at x."""
    return tuple((x, y) for y in ys)


def _through(x: float, y: float, right: float, up: float) -> Way:
    """A way of 40 m with a place in its middle."""
    return ((x - 20 * right, y - 20 * up), (x + 20 * right, y + 20 * up))


def walk(begin_s: float, length_m: float, speed: float) -> Speeds:
    """Speeds of a walk from rest to rest."""
    end_s = begin_s + length_m / speed
    return ((begin_s, 0.0), (begin_s + 0.3, speed), (end_s, speed), (end_s + 0.3, 0.0))


_HEADINGS: Final = ((1.0, 0.0), (0.6, 0.8), (0.0, -1.0), (-0.8, 0.6), (-0.6, -0.8))
# The usual traffic beside the ego vehicle, for scenarios that are about the lidar.
BESIDE: Final = (
    Mover("car", along(2.0, BACK), 8.0, 120.0, 6, -22.0),
    Mover("scooter", along(-3.7), 11.0, 52.0, 3, 16.0),
    Mover("cyclist", along(3.75, BACK), 4.5, 225.0, 3, 18.0),
    Mover("pedestrian", along(9.0), 1.4, 55.0, 8, -9.0),
    Mover("pedestrian", along(-8.8, BACK), 1.1, 245.0, 8, 8.0),
)
STAGES: Final[dict[str, Stage]] = {
    "standing": Stage(
        "nothing moves: walls, shop windows, parked cars, hedges, poles",
        (),
        (
            *PARKED,
            *POSTS,
            *(Row("bollard", y, 1.5) for y in (6.7, -6.7)),
            Row("shop", 15.0, 9.0, to_x=30.0),
            Row("hedge", 9.0, 4.1, from_x=34.0),
            Row("house", 18.0, 11.0, from_x=36.0),
            Row("hedge", -9.0, 4.5, share=0.8, to_x=30.0),
            Row("house", -18.0, 11.0, 180.0, to_x=30.0),
            Row("shop", -15.0, 9.0, 180.0, from_x=36.0),
        ),
    ),
    "crossing": Stage(
        "traffic that crosses at 20 m/s",
        (
            Mover("car", across(28.0, -200.0, 200.0), 20.0, 180.0, 6, 34.0),
            Mover("car", across(24.0, 200.0, -200.0), 20.0, 170.0, 6, 38.0),
            Mover("scooter", across(30.0, -200.0, 200.0), 14.0, 170.0, 3, 40.0),
            Mover("pedestrian", across(18.0, -8.0, 8.0), walk(1.0, 16.0, 1.5)),
        ),
        STREET,
        ego_speeds=((0.0, 1.0), (0.5, 1.0), (2.5, 0.0)),
        crossing_x=26.0,
    ),
    "crowd": Stage(
        "a crowd on a square, in all directions",
        tuple(
            Mover("pedestrian", _through(x, y, *_HEADINGS[n % 5]), 0.6 + 0.1 * (n % 11), 16.0)
            for n in range(60)
            for x, y in [(4.0 + 5.0 * (n % 6), 2.2 * (n // 6) - 11.0)]
        ),
        (Row("house", 27.0, 11.0), Row("house", -27.0, 11.0, 180.0),
         Row("tree", 16.0, 12.0), Row("bench", -16.0, 12.0), Row("tree", -18.0, 12.0)),
        ego_speeds=((0.0, 0.1),),
        road_half_width_m=100.0,
    ),
    "lorry": Stage(
        "a lorry alongside with a flat side, passing slowly",
        (
            Mover("lorry", along(1.6), 9.0, 52.0),
            Mover("lorry", along(1.6), 8.2, 76.0),
            Mover("car", along(-2.0), 8.0, 80.0),
            Mover("pedestrian", along(-9.0), 1.3, 66.0, 7, -9.0),
        ),
        STREET,
    ),
    "tunnel": Stage(
        "a tunnel with smooth walls, few lamps, niches and cabinets",
        (
            Mover("car", along(-2.0), 13.0, 80.0),
            Mover("van", along(-2.0), 13.0, 96.0),
            Mover("car", along(2.0, BACK), 14.0, 150.0, 6, -27.0),
            Mover("lorry", along(2.0, BACK), 14.0, 122.0),
        ),
        (Row("tunnel", 0.0, 20.0),),
        ego_speeds=((0.0, 1.5),),
        road_half_width_m=5.0,
    ),
    "bent_sweeps": Stage(
        "a fast drive through bends, each point measured at its own time",
        BESIDE,
        STREET,
        ego=((-30.0, -2.2), (10.0, -2.2), (30.0, -0.4), (50.0, -2.2), (70.0, -0.4), (90.0, -2.2),
             (110.0, -0.4), (300.0, -0.4)),
        ego_speeds=((0.0, 1.5),),
        sensor=Sensor(is_rolling=True),
    ),
}  # fmt: skip
