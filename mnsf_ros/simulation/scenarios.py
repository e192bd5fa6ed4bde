# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The staged scenarios of `mnsf simulate`: what stands where, what moves how, and how it is seen.

Places are metres in the world: the ego vehicle starts near (0, -2) and looks along +x, y is left.
Speeds are m/s, those of the ego vehicle shares of the setting `ego_speed_m_s`. Models are named as
the functions in `models`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

# Time in seconds and speed, linear between.
Speeds = tuple[tuple[float, float], ...]
Way = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Mover:
    """Things that move along a way, one behind the other.

    Attributes:
        model: What they are.
        way: Corners of the way, rounded by `radius_m`; beyond its ends it goes straight on.
        speeds: One speed, or a profile over time; constant before and after.
        at_m: Where the first one is on the way at the first time of its profile.
        count: How many there are.
        spacing_m: How far each is behind the one before.
        radius_m: Radius of the bends.
    """

    model: str
    way: Way
    speeds: float | Speeds
    at_m: float = 0.0
    count: int = 1
    spacing_m: float = 20.0
    radius_m: float = 8.0


@dataclass(frozen=True)
class Row:
    """Things at rest in a row along x, `pitch_m` apart, each there with the probability `share`."""

    model: str
    y: float
    pitch_m: float
    turn_deg: float = 0.0
    share: float = 1.0
    from_x: float = -60.0
    to_x: float = 200.0


@dataclass(frozen=True)
class Sensor:
    """How the lidar sees.

    Attributes:
        is_rolling: Whether each point has its own time; else a sweep is taken in an instant.
        degrees: Azimuth of a sweep. More than 360: it is cut by time, and a part is seen twice.
        rain_per_m: Share of the light that rain takes on each metre; drops near the lidar return.
    """

    is_rolling: bool = False
    degrees: float = 360.0
    rain_per_m: float = 0.0


@dataclass(frozen=True)
class Stage:
    """One scenario.

    Attributes:
        text: What it is, one line.
        movers: What moves.
        rows: What stands.
        ego: The way of the ego vehicle.
        ego_speeds: Its speeds, as shares of the setting.
        spin_deg_s: If not 0, the ego vehicle turns on the spot instead.
        crossing_x: Where a side street crosses; there are no rows within 14 m. None: nowhere.
        road_half_width_m: From where on the ground is a sidewalk.
        sensor: How all this is seen.
    """

    text: str
    movers: tuple[Mover, ...]
    rows: tuple[Row, ...]
    ego: Way = ((-30.0, -2.0), (300.0, -2.0))
    ego_speeds: Speeds = ((0.0, 1.0),)
    spin_deg_s: float = 0.0
    crossing_x: float | None = None
    road_half_width_m: float = 6.5
    sensor: Sensor = Sensor()


_HOUSES: Final = (Row("house", 15.7, 11.0), Row("house", -15.7, 11.0, 180.0))
_PARKED: Final = (Row("car", 5.4, 6.4, share=0.7), Row("car", -5.4, 6.4, 180.0, share=0.7))
_POSTS: Final = (
    *(Row("tree", y, 13.0) for y in (7.3, -7.3)),
    *(Row("lamp_post", y, 26.0, -turn, from_x=-53.0) for y, turn in ((7.3, 90.0), (-7.3, -90.0))),
)
_STREET: Final = (*_HOUSES, *_PARKED, *_POSTS)
_FORTH: Final = -60.0, 300.0
_BACK: Final = 300.0, -60.0


def _along(y: float, x: tuple[float, float] = _FORTH) -> Way:
    return ((x[0], y), (x[1], y))


def _across(x: float, *ys: float) -> Way:
    return tuple((x, y) for y in ys)


def _through(x: float, y: float, right: float, up: float) -> Way:
    """A way of 40 m with a place in its middle."""
    return ((x - 20 * right, y - 20 * up), (x + 20 * right, y + 20 * up))


def _walk(begin_s: float, length_m: float, speed: float) -> Speeds:
    """Speeds of a walk from rest to rest."""
    end_s = begin_s + length_m / speed
    return ((begin_s, 0.0), (begin_s + 0.3, speed), (end_s, speed), (end_s + 0.3, 0.0))


_HEADINGS: Final = ((1.0, 0.0), (0.6, 0.8), (0.0, -1.0), (-0.8, 0.6), (-0.6, -0.8))
# The usual mixture, for the scenarios that are about the lidar.
_BESIDE: Final = (
    Mover("car", _along(2.0, _BACK), 8.0, 120.0, 6, -22.0),
    Mover("scooter", _along(-3.7), 11.0, 52.0, 3, 16.0),
    Mover("cyclist", _along(3.75, _BACK), 4.5, 225.0, 3, 18.0),
    Mover("pedestrian", _along(9.0), 1.4, 55.0, 8, -9.0),
    Mover("pedestrian", _along(-8.8, _BACK), 1.1, 245.0, 8, 8.0),
)
_TRAFFIC: Final = (*_BESIDE, Mover("car", _along(-2.0), 8.0, 76.0, 2, 31.0))

STAGES: Final[dict[str, Stage]] = {
    "walkers": Stage(
        "people along walls, and out from between parked cars",
        (
            *(Mover("pedestrian", _along(y), 1.0 + 0.12 * n, 66.0 + 9.0 * n)
              for n in range(8) for y in (10.3, -10.3)),
            *(Mover("pedestrian", _along(y, _BACK), 1.2, 290.0 - 13.0 * n)
              for n in range(5) for y in (9.5, -9.5)),
            *(Mover("pedestrian", _across(x, 8.0 * side, 4.2 * side), _walk(time, 3.8, 1.6))
              for x, time in ((20.0, 0.4), (32.8, 1.6), (52.0, 3.8), (64.8, 5.4), (84.0, 7.6))
              for side in (1.0, -1.0)),
        ),
        _STREET,
    ),
    "scooters": Stage(
        "scooters that overtake on both sides at 11 to 13 m/s",
        (
            Mover("scooter", _along(-3.7), 11.0, 66.0, 5, 14.0),
            Mover("scooter", _along(-0.2), 13.0, 58.0, 5, 17.0),
            Mover("scooter", _along(3.7, _BACK), 12.0, 210.0, 5, -25.0),
            Mover("car", _along(-2.0), 8.0, 78.0),
            Mover("car", _along(2.0, _BACK), 8.0, 170.0, 6, -18.0),
        ),
        _STREET,
    ),
    "lorry": Stage(
        "a lorry alongside with a flat side, passing slowly",
        (
            Mover("lorry", _along(1.6), 9.0, 52.0),
            Mover("lorry", _along(1.6), 8.2, 76.0),
            Mover("car", _along(-2.0), 8.0, 80.0),
            Mover("pedestrian", _along(-9.0), 1.3, 66.0, 7, -9.0),
        ),
        _STREET,
    ),
    "bus": Stage(
        "articulated buses that turn at a crossing",
        (
            *(Mover(part, ((120.0, 2.0), (32.0, 2.0), (32.0, 90.0)), 5.0, at, radius_m=9.0)
              for part, at in (("bus_front", 72.0), ("bus_rear", 63.0))),
            *(Mover(part, ((32.0, -90.0), (32.0, 2.0), (-90.0, 2.0)), 6.0, at, radius_m=9.0)
              for part, at in (("bus_front", 74.0), ("bus_rear", 65.0))),
            Mover("pedestrian", _along(9.0, _BACK), 1.3, 282.0, 5, -7.0),
        ),
        _STREET,
        ego_speeds=((0.0, 1.0), (0.5, 1.0), (2.5, 0.0)),
        crossing_x=30.0,
    ),
    "crossing": Stage(
        "traffic that crosses at 20 m/s",
        (
            Mover("car", _across(28.0, -200.0, 200.0), 20.0, 180.0, 6, 34.0),
            Mover("car", _across(24.0, 200.0, -200.0), 20.0, 170.0, 6, 38.0),
            Mover("scooter", _across(30.0, -200.0, 200.0), 14.0, 170.0, 3, 40.0),
            Mover("pedestrian", _across(18.0, -8.0, 8.0), _walk(1.0, 16.0, 1.5)),
        ),
        _STREET,
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
    "slow_walkers": Stage(
        "people who walk at 0.3 to 1 m/s",
        (
            *(Mover("pedestrian", _along(y), 0.3 + 0.1 * n, 66.0 + 4.5 * n)
              for n in range(8) for y in (8.6, -10.2)),
            *(Mover("pedestrian", _across(x, -7.8, 7.8), speed, 1.0)
              for x, speed in ((28.0, 0.3), (31.5, 0.5), (35.0, 0.7), (38.5, 0.9))),
        ),
        (*_HOUSES, *_POSTS),
        ego_speeds=((0.0, 0.25),),
    ),
    "touching": Stage(
        "people and scooters that touch a hedge, coaches of 17 m",
        (
            *(Mover("pedestrian", _along(6.85), 0.9 + 0.1 * n, 60.0 + 6.0 * n) for n in range(9)),
            Mover("scooter", _along(-6.6), 6.0, 58.0, 4, -12.0),
            Mover("coach", _along(2.2, _BACK), 8.0, 228.0, 2, -40.0),
        ),
        (*_HOUSES, Row("hedge", 7.5, 3.9), Row("hedge", -7.5, 3.9)),
    ),
    "stop_and_go": Stage(
        "cars, scooters and people that start and stop",
        (
            Mover("car", _along(-2.0), ((1.0, 8.0), (3.0, 0.0), (4.5, 0.0), (6.5, 8.0)), 83.0),
            Mover("car", _along(2.0, _BACK), ((0.5, 8.0), (2.5, 0.0), (5.0, 0.0), (7.5, 8.0)),
                  240.0),
            Mover("van", _along(2.0, _BACK), ((1.0, 8.0), (3.2, 0.0), (5.5, 0.0), (8.0, 8.0)),
                  229.0),
            Mover("scooter", _along(-3.7), ((1.0, 9.0), (2.5, 0.0), (5.0, 0.0), (6.0, 10.0)), 74.0),
            *(Mover("pedestrian", _along(y), _walk(begin, 3.0, 1.4), 70.0 + 8.0 * n)
              for n, begin in enumerate((0.5, 1.5, 3.0, 5.0, 6.5)) for y in (8.8, -9.4)),
        ),
        _STREET,
        ego_speeds=((1.0, 1.0), (3.0, 0.0), (4.8, 0.0), (6.8, 1.0)),
    ),
    "tunnel": Stage(
        "a tunnel with smooth walls, few lamps, niches and cabinets",
        (
            Mover("car", _along(-2.0), 13.0, 80.0),
            Mover("van", _along(-2.0), 13.0, 96.0),
            Mover("car", _along(2.0, _BACK), 14.0, 150.0, 6, -27.0),
            Mover("lorry", _along(2.0, _BACK), 14.0, 122.0),
        ),
        (Row("tunnel", 0.0, 20.0),),
        ego_speeds=((0.0, 1.5),),
        road_half_width_m=5.0,
    ),
    "parking_lot": Stage(
        "a parking lot, with the robot turning on the spot",
        (
            Mover("car", ((9.0, -18.0), (9.0, 2.5), (60.0, 2.5)), 2.5, 2.0, radius_m=5.0),
            Mover("car", ((-40.0, 3.5), (60.0, 3.5)), 3.5, 10.0),
            Mover("pedestrian", _across(-7.0, -14.0, 14.0), 1.2, 3.0),
            Mover("pedestrian", _across(5.0, 14.0, -14.0), 1.5, 5.0, 2, -4.0),
            Mover("pedestrian", ((-12.0, -6.0), (12.0, -5.0)), 0.8, 4.0),
        ),
        (*(Row("car", y, 2.7, 90.0, share, -26.0, 26.0)
           for y, share in ((9.0, 0.6), (-9.5, 0.7), (14.5, 0.7), (-15.0, 0.6))),
         Row("lamp_post", 11.8, 18.0, from_x=-27.0, to_x=28.0), Row("house", 27.0, 11.0)),
        spin_deg_s=40.0,
        road_half_width_m=100.0,
    ),
    "alley": Stage(
        "an alley with shop windows, seen through at some angles",
        (
            Mover("pedestrian", _along(2.4), 1.3, 64.0, 6, -7.0),
            Mover("pedestrian", _along(-2.5, _BACK), 0.9, 232.0, 5, 7.5),
            Mover("cyclist", _along(0.9, _BACK), 4.0, 205.0, 2, -20.0),
        ),
        (Row("shop", 8.0, 9.0), Row("shop", -8.0, 9.0, 180.0)),
        ego=((-30.0, -0.6), (300.0, -0.6)),
        ego_speeds=((0.0, 0.3),),
        road_half_width_m=100.0,
    ),
    "standing": Stage(
        "nothing moves: walls, shop windows, parked cars, hedges, poles",
        (),
        (
            *_PARKED,
            *_POSTS,
            *(Row("bollard", y, 1.5) for y in (6.7, -6.7)),
            Row("shop", 15.0, 9.0, to_x=30.0),
            Row("hedge", 9.0, 4.1, from_x=34.0),
            Row("house", 18.0, 11.0, from_x=36.0),
            Row("hedge", -9.0, 4.5, share=0.8, to_x=30.0),
            Row("house", -18.0, 11.0, 180.0, to_x=30.0),
            Row("shop", -15.0, 9.0, 180.0, from_x=36.0),
        ),
    ),
    "seam": Stage(
        "sweeps of 395 degrees, cut by time",
        _TRAFFIC,
        _STREET,
        sensor=Sensor(is_rolling=True, degrees=395.0),
    ),
    "bent_sweeps": Stage(
        "a fast drive through bends, each point measured at its own time",
        _BESIDE,
        _STREET,
        ego=((-30.0, -2.2), (10.0, -2.2), (30.0, -0.4), (50.0, -2.2), (70.0, -0.4), (90.0, -2.2),
             (110.0, -0.4), (300.0, -0.4)),
        ego_speeds=((0.0, 1.5),),
        sensor=Sensor(is_rolling=True),
    ),
    "rain": Stage(
        "rain: lost returns, drops near the lidar, noise",
        _TRAFFIC,
        _STREET,
        sensor=Sensor(rain_per_m=0.012),
    ),
}  # fmt: skip
