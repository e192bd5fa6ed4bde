# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Random worlds: lidar, place, ego motion and traffic, all drawn from one seed.

The tables declare what can be drawn, and how often. Laterals are metres to the left of the middle
of the street; the ego vehicle begins near x = 0 and looks along +x.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, TypeVar

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray
from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model
from mnsf_ros.simulation.routes import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    LEVEL,
    Clearance,
    EgoMotion,
    Route,
    Slope,
    SpeedProfile,
    Trip,
    draw_sway,
)
from mnsf_ros.simulation.scene import Scene, street_scene
from mnsf_ros.simulation.sensor import Sensor
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.street import LANE_LATERAL_M, Centerline, Crossing, Street
from mnsf_ros.simulation.traffic import right_turn, straight_over, walk

_LEAST_S: Final = 10.0
_APART_M: Final = 0.02
_CLEAR_OF_CROSSING_M: Final = 14.0
# Movers that would meet something are left out; so many are tried for each that is wanted.
_TRIES: Final = 4

Maker = Callable[[np.random.Generator], Model]
Item = TypeVar("Item")

# Name to share.
_LIDARS: Final = {"16": 0.2, "32": 0.2, "64": 0.2, "128": 0.2, "raster": 0.1, "rosette": 0.1}
_COLUMNS: Final = {900: 0.3, 1024: 0.3, 1800: 0.4}
_PLACES: Final = {
    "street": 0.35,
    "crossing": 0.2,
    "country road": 0.15,
    "square": 0.2,
    "tunnel": 0.1,
}
_BACKS: Final[dict[str, dict[str, float]]] = {
    "street": {"houses": 0.4, "shops": 0.25, "hedge": 0.2, "fence": 0.15},
    "crossing": {"houses": 0.6, "shops": 0.2, "hedge": 0.1, "fence": 0.1},
    "country road": {"hedge": 0.2, "fence": 0.3, "bank": 0.4, "nothing": 0.1},
    "square": {"houses": 0.6, "nothing": 0.4},
    "tunnel": {"nothing": 1.0},
}
# Of a back: its things, their spacing, and how far behind the edge their origins are.
_BACK_ROWS: Final[dict[str, tuple[Maker, float, float]]] = {
    "houses": (partial(models.house, width_m=11.0), 10.9, 4.0 - models.HOUSE_WALL_Y_M),
    "shops": (models.shop, 9.0, 8.5),
    "hedge": (models.hedge, 4.1, 3.3),
    "fence": (models.fence, 4.0, 3.2),
    "bank": (models.bank, 10.0, 3.2),
}
_POSTS: Final[tuple[Maker, ...]] = (
    *(models.tree, models.tree, models.lamp_post, models.sign, models.bollard, models.bollard),
    *(models.litter_bin, models.cabinet, models.bench),
)
_PARKED: Final[tuple[Maker, ...]] = (models.car, models.car, models.car, models.van, models.lorry)
_ON_SQUARE: Final[tuple[Maker, ...]] = (*_POSTS, *_PARKED, models.hedge, models.shelter)
_EGOS: Final = {"standing": 0.2, "on foot": 0.2, "driving": 0.4, "fast": 0.2}
_EGO_SPEEDS_M_S: Final = {
    "standing": (0.0, 0.0),
    "on foot": (0.5, 1.8),
    "driving": (3.0, 15.0),
    "fast": (15.0, 25.0),
}
# Sway over that of a car on its springs.
_SHAKEN: Final = {"standing": 0.1, "on foot": 6.0, "driving": 1.0, "fast": 2.0}
# Of ego vehicle and traffic.
_BEHAVIOURS: Final = {"steady": 0.5, "brakes": 0.2, "starts": 0.15, "changes": 0.15}
# Mean number of movers, to share.
_NUMBERS: Final = {0: 0.1, 4: 0.3, 12: 0.35, 30: 0.25}


@dataclass(frozen=True)
class _Kind:
    """Traffic of one kind: its share, models, speeds, and where it goes.

    Of two models the second one follows `behind_m` behind the first one, `beside_m` left of it.
    """

    share: float
    makers: tuple[Maker, ...]
    speeds_m_s: tuple[float, float]
    way: str
    behind_m: float = 0.0
    beside_m: float = 0.0


_KINDS: Final = (
    _Kind(0.2, (models.car,), (2.0, 20.0), "lane"),
    _Kind(0.06, (models.van,), (2.0, 18.0), "lane"),
    _Kind(0.07, (models.lorry,), (1.0, 16.0), "lane"),
    _Kind(0.03, (models.coach,), (2.0, 12.0), "lane"),
    _Kind(0.03, (models.bus_part, models.bus_part), (2.0, 10.0), "lane", behind_m=9.0),
    _Kind(0.03, (models.car, models.trailer), (2.0, 12.0), "lane", behind_m=4.2),
    _Kind(0.08, (models.cyclist,), (2.0, 8.0), "edge"),
    _Kind(0.06, (models.scooter,), (4.0, 14.0), "edge"),
    _Kind(0.14, (models.pedestrian,), (0.5, 2.0), "sidewalk"),
    _Kind(0.05, (models.pedestrian, models.child), (0.4, 1.6), "sidewalk", beside_m=0.5),
    _Kind(0.03, (models.pedestrian, models.dog), (0.5, 3.0), "sidewalk", behind_m=0.9),
    _Kind(0.08, (models.pedestrian,), (0.5, 2.5), "across"),
    _Kind(0.03, (models.child,), (1.0, 3.5), "across"),
    _Kind(0.02, (models.cyclist,), (2.0, 5.0), "sidewalk"),
    _Kind(0.05, (models.car,), (3.0, 18.0), "side street"),
    _Kind(0.04, (models.van,), (3.0, 5.0), "turn"),
)


def build_scene(settings: SimulationSettings) -> Scene:
    """Returns the scene of a recording; equal settings give equal scenes."""
    if settings.scenario == "street":
        return street_scene(settings)
    # A generator of its own for each part: another lidar does not change the traffic.
    lidar, place, traffic = np.random.default_rng([settings.seed, 4]).spawn(3)
    sensor = _lidar(lidar)
    # A shorter recording of a world is the beginning of a longer one.
    clearance = Clearance(max(settings.duration_s, _LEAST_S) + 1.0, margin_m=_APART_M)
    world = _World(place, clearance)
    if settings.scenario == "random":
        world.add_traffic(traffic)
    text = f"{sensor.kind}, {sensor.rate_hz:g} Hz{', rain' if sensor.rain_per_m else ''}; {world}"
    return Scene(world.street, tuple(world.bodies), world.ego, sensor, text)


def _lidar(rng: np.random.Generator) -> Sensor:
    kind = _drawn(_LIDARS, rng)
    sensor = Sensor(
        kind=f"{kind} beams" if kind.isdigit() else "solid state",
        elevations_deg=_elevations_deg(kind, rng),
        num_columns=_drawn(_COLUMNS, rng),
        rate_hz=_drawn({10.0: 0.75, 20.0: 0.25}, rng),
        range_noise_m=rng.uniform(0.005, 0.03),
        dropout=rng.uniform(0.0, 0.15),
        max_range_m=rng.uniform(70.0, 200.0),
        is_rolling=bool(rng.uniform() < 0.5),
        rain_per_m=_drawn({0.0: 0.85, rng.uniform(0.002, 0.012): 0.15}, rng),
    )
    if kind == "raster":
        return replace(sensor, num_columns=1800, degrees=rng.uniform(100.0, 130.0))
    if kind == "rosette":
        num_points, degrees = int(rng.integers(20_000, 48_000)), rng.uniform(70.0, 120.0)
        rosette = replace(sensor, num_columns=num_points, is_rolling=True, is_rosette=True)
        return replace(rosette, degrees=degrees)
    degrees = _drawn({360.0: 0.8, 395.0: 0.2}, rng) if sensor.is_rolling else 360.0
    return replace(sensor, degrees=degrees)


def _elevations_deg(kind: str, rng: np.random.Generator) -> FloatArray:
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


class _World:
    """A place with an ego vehicle; traffic is added to it.

    Attributes:
        street: The ground.
        bodies: All things on it.
        ego: The ego vehicle.
    """

    def __init__(self, rng: np.random.Generator, clearance: Clearance) -> None:
        self._place, self._ego_kind = _drawn(_PLACES, rng), _drawn(_EGOS, rng)
        self._clearance = clearance
        self._counts: Counter[str] = Counter()
        self._speed_m_s = rng.uniform(*_EGO_SPEEDS_M_S[self._ego_kind])
        if self._place == "square" and self._ego_kind == "fast":
            self._ego_kind, self._speed_m_s = "driving", self._speed_m_s / 3
        self.street = self._ground(rng)
        self.ego = self._ego(rng)
        length_m = 0.8 if self._ego_kind == "on foot" else EGO_LENGTH_M
        clearance.accept(self.ego.trip, length_m, min(length_m, EGO_WIDTH_M))
        self.bodies = list(self._things(rng))

    def __str__(self) -> str:
        """What was drawn, in a line."""
        counts = ", ".join(f"{number} {name}" for name, number in sorted(self._counts.items()))
        slope = f", slope {self.street.slope.grade:.0%}" if self.street.slope.grade else ""
        return f"{self._place}{slope}; {self._ego_kind}, {self._speed_m_s:.1f} m/s; {counts}"

    def _ground(self, rng: np.random.Generator) -> Street:
        wavelength_m = rng.uniform(60.0, 200.0)
        wave = 2 * math.pi / wavelength_m
        # Nothing turns faster than tyres hold, or sharper than walls beside the street.
        most_m = min(4.0, 0.2 / wave, 2.5 / max(self._speed_m_s * wave, 0.1) ** 2)
        bend = Centerline(rng.uniform(0.0, most_m), wavelength_m, rng.uniform(0.0, 2 * math.pi))
        slope = Slope(rng.uniform(-10.0, 50.0), rng.uniform(-0.1, 0.1))
        half_width_m = {"square": 100.0, "tunnel": 5.0}.get(self._place, rng.uniform(5.2, 8.0))
        end_x = 10 * self._speed_m_s + 110.0
        if self._place == "tunnel":
            return Street(replace(bend, amplitude_m=0.0), -90.0, end_x, (), half_width_m)
        crossings: tuple[Crossing, ...] = ()
        if self._place == "crossing":
            crossings = bend.crossings(rng.uniform(14.0, 40.0, 1))
        if rng.uniform() < 0.7:
            slope = LEVEL
        return Street(bend, -90.0, end_x, crossings, half_width_m, slope)

    def _ego(self, rng: np.random.Generator) -> EgoMotion:
        street, on_foot = self.street, self._ego_kind == "on foot"
        beside = on_foot and street.half_width_m < 10 and self._place != "tunnel"
        lateral = -street.half_width_m - 1.7 if beside and rng.uniform() < 0.6 else -LANE_LATERAL_M
        route = street.lane(lateral, forward=True)
        profile = _profile(self._speed_m_s, rng)
        at_m = route.arc_nearest(0.0, float(street.centerline.place(np.zeros(1), lateral)[0, 1]))
        shaken = _SHAKEN[self._ego_kind] * rng.uniform(0.5, 1.5)
        sway = draw_sway(rng) * (shaken, rng.uniform(1.0, 4.0), 1.0)
        height_m = rng.uniform(0.45, 1.3) if on_foot else rng.uniform(1.5, 2.4)
        spread = 0.08 if rng.uniform() < 0.2 else 0.015
        mounting = (rng.normal(0.0, spread), rng.normal(0.0, spread / 2), height_m)
        return EgoMotion(Trip.starting_at(route, profile, at_m), sway, mounting)

    def _things(self, rng: np.random.Generator) -> Iterator[Body]:
        """Yields everything at rest."""
        edge_m = self.street.half_width_m
        if self._place == "tunnel":
            yield from self._row((models.tunnel,), 0.0, 20.0, rng)
        if self._place == "square":
            yield from self._scattered(rng)
            edge_m = rng.uniform(40.0, 60.0)
        for side in (1.0, -1.0):
            if self._place not in ("tunnel", "square"):
                pitch_m, share = rng.uniform(6.5, 8.0), rng.choice([0.0, 0.3, 0.9])
                parked = self._row(_PARKED, side * (edge_m - 1.25), pitch_m, rng, share)
                posts = self._row(_POSTS, side * (edge_m + 0.5), rng.uniform(2.0, 9.0), rng, 0.8)
                yield from filter(self._is_free, (*parked, *posts))
            back = _drawn(_BACKS[self._place], rng)
            if back in _BACK_ROWS:
                maker, pitch_m, behind_m = _BACK_ROWS[back]
                yield from self._row((maker,), side * (edge_m + behind_m), pitch_m, rng)

    def _is_free(self, body: Body) -> bool:
        """Whether nothing that was there before is in its way; from now on it is in the way."""
        pose = body.world_from_body(0.0)
        forward = np.array([pose[:2, 3], pose[:2, 3] + pose[:2, 0]])
        trip = Trip(Route.through(forward), SpeedProfile.steady(0.0), 0.0)
        return self._clearance.accept(trip, body.model.length_m, body.model.width_m)

    def _row(
        self,
        makers: Sequence[Maker],
        lateral: float,
        pitch_m: float,
        rng: np.random.Generator,
        share: float = 1.0,
    ) -> Iterator[Body]:
        turn = math.pi if lateral < 0 else 0.0
        for x in np.arange(self.street.start_x, self.street.end_x, pitch_m).tolist():
            model, is_there = _one_of(makers, rng), rng.uniform() < share
            if is_there and self.street.clear_of_crossings(x, _CLEAR_OF_CROSSING_M):
                yield Body(model, self.street.pose(x, lateral, turn))

    def _scattered(self, rng: np.random.Generator) -> Iterator[Body]:
        for _ in range(int(rng.integers(5, 40))):
            model = _one_of(_ON_SQUARE, rng)
            x, lateral, turn = rng.uniform((-60.0, -22.0, -3.0), (90.0, 22.0, 3.0))
            body = Body(model, self.street.pose(x, lateral, turn))
            if self._is_free(body):
                yield body

    def add_traffic(self, rng: np.random.Generator) -> None:
        """Adds movers that meet nothing."""
        number = rng.poisson(_drawn(_NUMBERS, rng))
        for _ in range(_TRIES * number):
            kind = _drawn({kind: kind.share for kind in _KINDS}, rng)
            first = self._trip(kind, rng)
            if first is None or self._counts.total() >= number:
                continue
            route, arc_m = first.route.beside(kind.beside_m), first.start_arc_m - kind.behind_m
            both = (first, replace(first, route=route, start_arc_m=arc_m))
            group = [(maker(rng), trip) for maker, trip in zip(kind.makers, both, strict=False)]
            if self._clearance.accept_together(
                (trip, model.length_m, model.width_m) for model, trip in group
            ):
                self.bodies += [Body(model, trip) for model, trip in group]
                self._counts[" with ".join(maker.__name__ for maker in kind.makers)] += 1

    def _trip(self, kind: _Kind, rng: np.random.Generator) -> Trip | None:
        """Returns a trip; None where there is no such way."""
        street, speed_m_s = self.street, rng.uniform(*kind.speeds_m_s)
        if kind.way in ("turn", "side street"):
            if not street.crossings:
                return None
            at_s, is_left = rng.uniform(-0.5, 3.0), bool(rng.integers(2))
            if kind.way == "turn":
                return right_turn(street, street.crossings[0], at_s, speed_m_s, leaving=is_left)
            return straight_over(street, street.crossings[0], at_s, speed_m_s, toward_left=is_left)
        if self._place == "tunnel" and kind.way in ("sidewalk", "across"):
            return None
        if self._place != "square" and kind.way == "across":
            return self._walk_across(speed_m_s, rng)
        route = self._open_way(rng) if self._place == "square" else self._way(kind.way, rng)
        if kind.way == "lane" and rng.uniform() < 0.4 and self._speed_m_s > 1.0:
            speed_m_s = self._speed_m_s * rng.uniform(0.7, 1.3)
        x, y = rng.uniform((-35.0, -10.0), (55.0, 10.0))
        return Trip.starting_at(route, _profile(speed_m_s, rng), route.arc_nearest(x, y))

    def _walk_across(self, speed_m_s: float, rng: np.random.Generator) -> Trip:
        end_m = self.street.half_width_m + 2.0
        laterals = rng.choice([-1.0, 1.0]) * np.linspace(-end_m, end_m, 60)
        route = self.street.route(np.full(60, rng.uniform(4.0, 45.0)), laterals)
        return walk(route, rng.uniform(-route.length_m / speed_m_s, 2.0), speed_m_s)

    def _way(self, way: str, rng: np.random.Generator) -> Route:
        edge_m, side = self.street.half_width_m, rng.choice([-1.0, 1.0])
        if way == "lane":
            lateral, forward = side * LANE_LATERAL_M + rng.uniform(-0.3, 0.3), side < 0
        elif way == "edge":
            lateral = side * (edge_m - rng.choice([0.7, 2.7]) + rng.uniform(-0.2, 0.2))
            forward = side < 0
        else:
            lateral, forward = side * (edge_m + rng.uniform(0.9, 2.45)), bool(rng.integers(2))
        return self.street.lane(lateral, forward=forward)

    def _open_way(self, rng: np.random.Generator) -> Route:
        """Returns a straight line or an arc through some place of a square."""
        x, y, heading = rng.uniform((-15.0, -18.0, -math.pi), (45.0, 18.0, math.pi))
        bend = rng.choice([0.0, 1.0, -1.0], p=[0.5, 0.25, 0.25]) / rng.uniform(6.0, 30.0)
        yaw = heading + bend * np.arange(-80.0, 80.0, 0.5)
        steps = 0.5 * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        points = np.cumsum(steps, axis=0)
        return Route.through(points - points[len(points) // 2] + (x, y), self.street.slope)


def _profile(speed_m_s: float, rng: np.random.Generator) -> SpeedProfile:
    """Returns a speed that stays, falls to a stop, rises from one, or changes."""
    behaviour = _drawn(_BEHAVIOURS, rng)
    moment_s, change_m_s2 = rng.uniform(0.5, 2.5), rng.uniform(1.5, 5.0)
    first, last = {
        "steady": (speed_m_s, speed_m_s),
        "brakes": (speed_m_s, 0.0),
        "starts": (0.0, speed_m_s),
        "changes": (speed_m_s, speed_m_s * rng.uniform(0.4, 1.6)),
    }[behaviour]
    if first == last:
        return SpeedProfile.steady(speed_m_s)
    lasts_s = abs(last - first) / change_m_s2
    # Both a start and a stop happen early in a recording.
    begin_s = moment_s if behaviour == "starts" else moment_s - lasts_s
    return SpeedProfile(np.array([begin_s, begin_s + lasts_s]), np.array([first, last]))


def _one_of(makers: Sequence[Maker], rng: np.random.Generator) -> Model:
    return makers[int(rng.integers(len(makers)))](rng)


def _drawn(shares: Mapping[Item, float], rng: np.random.Generator) -> Item:
    """Returns one of the keys, with the probability of its share."""
    names, weights = list(shares), np.array(list(shares.values()))
    return names[rng.choice(len(names), p=weights / weights.sum())]
