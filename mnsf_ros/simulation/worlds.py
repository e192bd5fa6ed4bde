# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Worlds: lidar, place, ego motion and traffic, drawn from one seed.

The ego vehicle begins near x = 0 and looks along +x.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Final

import numpy as np

from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Maker, Model
from mnsf_ros.simulation.conditions import Draws, draws_of, sensor_under, wetness_under
from mnsf_ros.simulation.rooms import rooms_scene
from mnsf_ros.simulation.routes import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    LEVEL,
    Clearance,
    Route,
    SensorTrip,
    Slope,
    SpeedProfile,
    Trip,
)
from mnsf_ros.simulation.scene import Scene
from mnsf_ros.simulation.sensor import Sensor, drawn_sensor, sensor_of
from mnsf_ros.simulation.settings import INDOORS, Scenario, SimulationSettings, drawn, scenario_of
from mnsf_ros.simulation.street import LANE_LATERAL_M, Centerline, Crossing, Street
from mnsf_ros.simulation.traffic import Traffic, draw_profile, standing_start

_LEAST_S: Final = 10.0
_APART_M: Final = 0.02
_CLEAR_OF_CROSSING_M: Final = 14.0
_CROSSING_SPACING_M: Final = 120.0
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
# Of walls that people walk along: how far behind the edge their fronts are.
_FRONTS_M: Final = {"houses": 3.7, "shops": 4.0}
_SMOOTH_WALL_M: Final = 3.1
_ON_SQUARE_M: Final = 20.0
_POSTS: Final[tuple[Maker, ...]] = (
    *(models.tree, models.tree, models.lamp_post, models.sign, models.bollard, models.bollard),
    *(models.litter_bin, models.cabinet, models.bench),
)
_PARKED: Final[tuple[Maker, ...]] = (models.car, models.car, models.car, models.van, models.lorry)
_ON_SQUARE: Final[tuple[Maker, ...]] = (*_POSTS, *_PARKED, models.hedge, models.shelter)
# Limits of weaving: of vehicles by their tyres, aside, and across the street (60 degrees).
_TYRES_M_S2: Final = 8.0
_WEAVE_M: Final = 2.5
_WEAVE_SLOPE: Final = math.tan(math.radians(60.0))
_WEAVE_STEP_M: Final = 0.02
# Pitch (rad), roll (rad) and heave (m) of a car on its springs, and sway of others over that.
_SWAY: Final = np.array([0.0020, 0.0015, 0.010])
_SHAKEN: Final = {"standing": 0.1, "on foot": 6.0, "driving": 1.0, "fast": 2.0}


def build_scene(settings: SimulationSettings) -> Scene:
    """Returns the scene of a recording; equal settings give equal scenes."""
    # A generator of its own for each part: another lidar does not change the traffic.
    lidar, place, traffic, others = np.random.default_rng([settings.seed, 4]).spawn(4)
    if settings.scenario in INDOORS:
        return rooms_scene(settings, lidar, place, traffic)
    scenario = scenario_of(settings)
    draws = draws_of(scenario.conditions, others)
    sensor = sensor_of(settings) if settings.scenario == "street" else drawn_sensor(lidar)
    sensor = replace(sensor_under(sensor, draws), is_fixed=settings.directions == "fixed")
    if scenario.turns_deg_s is not None:
        sensor = replace(sensor, is_rolling=True)
    # A shorter recording of a world is the beginning of a longer one.
    duration_s = max(settings.duration_s, _LEAST_S)
    world = _World(scenario, duration_s, place, draws, settings.stands_s)
    rain = ["rain"] if sensor.rain_per_m else []
    text = ", ".join([sensor.kind, f"{sensor.rate_hz:g} Hz", *rain, *draws])
    return replace(world.scene(sensor, text, traffic), wetness=wetness_under(draws))


class _World:
    """A place with an ego vehicle."""

    def __init__(
        self,
        scenario: Scenario,
        duration_s: float,
        rng: np.random.Generator,
        draws: Draws,
        stands_s: float,
    ) -> None:
        self._scenario, self._duration_s, self._stands_s = scenario, duration_s, stands_s
        # Laterals of walls that people can walk along.
        self._walls_m: list[float] = []
        # One second more than recorded: the last sweeps' truth looks one interval ahead.
        self._clearance = Clearance(duration_s + 1.0, margin_m=_APART_M)
        self._place, self._ego_kind = drawn(scenario.places, rng), drawn(scenario.egos, rng)
        self._speed_m_s = rng.uniform(*scenario.speeds_m_s[self._ego_kind])
        if self._place == "square" and self._ego_kind == "fast":
            self._ego_kind, self._speed_m_s = "driving", self._speed_m_s / 3
        self._street = self._ground(rng)
        self._ego = self._moving_lidar(rng)
        length_m = 0.8 if self._ego_kind == "on foot" else EGO_LENGTH_M
        self._clearance.accept((self._ego.trip, length_m, min(length_m, EGO_WIDTH_M)))
        self._things = [*self._things_at_rest(rng), *self._conditions(draws)]

    def scene(self, sensor: Sensor, text: str, rng: np.random.Generator) -> Scene:
        """Returns the scene with traffic drawn; `text` describes the lidar."""
        traffic = Traffic(
            self._scenario,
            self._place,
            self._street,
            self._speed_m_s,
            self._clearance,
            tuple(self._walls_m),
        )
        groups = list(traffic.drawn(rng))
        counts = ", ".join(
            f"{count} {name}" for name, count in sorted(Counter(name for name, _ in groups).items())
        )
        slope = f", slope {self._street.slope.grade:.0%}" if self._street.slope.grade else ""
        world = f"{self._place}{slope}; {self._ego_kind}, {self._speed_m_s:.1f} m/s; {counts}"
        everything = (*self._things, *chain(*(bodies for _, bodies in groups)))
        return Scene(self._street, everything, self._ego, sensor, f"{text}; {world}")

    def _ground(self, rng: np.random.Generator) -> Street:
        wavelength_m = rng.uniform(60.0, 200.0)
        wave = 2 * math.pi / wavelength_m
        # Nothing turns faster than tyres hold, or sharper than walls beside the street.
        most_m = min(4.0, 0.2 / wave, 2.5 / max(self._speed_m_s * wave, 0.1) ** 2)
        bend = Centerline(rng.uniform(0.0, most_m), wavelength_m, rng.uniform(0.0, 2 * math.pi))
        slope = Slope(rng.uniform(-10.0, 50.0), rng.uniform(-0.1, 0.1))
        half_width_m = {"square": 100.0, "tunnel": 5.0}.get(self._place, rng.uniform(5.2, 8.0))
        end_x = self._duration_s * self._speed_m_s + 110.0
        if self._place == "tunnel":
            return Street(replace(bend, amplitude_m=0.0), -90.0, end_x, (), half_width_m)
        crossings: tuple[Crossing, ...] = ()
        if self._place == "crossing":
            further_m = (self._duration_s - _LEAST_S) * self._speed_m_s
            first_x = rng.uniform(14.0, 40.0)
            places_x = np.arange(first_x, first_x + further_m + 1.0, _CROSSING_SPACING_M)
            crossings = bend.crossings(places_x)
        if rng.uniform() < self._scenario.level:
            slope = LEVEL
        return Street(bend, -90.0, end_x, crossings, half_width_m, slope)

    def _moving_lidar(self, rng: np.random.Generator) -> SensorTrip:
        street, on_foot = self._street, self._ego_kind == "on foot"
        beside = on_foot and street.half_width_m < 10 and self._place != "tunnel"
        lateral = -street.half_width_m - 1.7 if beside and rng.uniform() < 0.6 else -LANE_LATERAL_M
        route = street.lane(lateral, forward=True)
        if self._scenario.turns_deg_s is not None:
            turn_rad_s = math.radians(rng.uniform(*self._scenario.turns_deg_s))
            route = self._weaving(lateral, min(turn_rad_s, _TYRES_M_S2 / self._speed_m_s))
        profile = draw_profile(self._speed_m_s, self._scenario.behaviours, rng)
        if self._stands_s:
            profile = standing_start(self._speed_m_s, self._stands_s)
        at_m = route.arc_nearest(0.0, float(street.centerline.place(np.zeros(1), lateral)[0, 1]))
        shaken = _SHAKEN[self._ego_kind] * rng.uniform(0.5, 1.5)
        frequency, phase = rng.uniform(0.7, 1.4, 3), rng.uniform(0.0, 2 * math.pi, 3)
        sway = np.stack([shaken * _SWAY, rng.uniform(1.0, 4.0) * frequency, phase], axis=1)
        height_m = rng.uniform(0.45, 1.3) if on_foot else rng.uniform(1.5, 2.4)
        spread = 0.08 if rng.uniform() < 0.2 else 0.015
        mounting = (rng.normal(0.0, spread), rng.normal(0.0, spread / 2), height_m)
        return SensorTrip(Trip.starting_at(route, profile, at_m), sway, mounting)

    def _weaving(self, lateral: float, turn_rad_s: float) -> Route:
        """The lane at a lateral offset in sine waves: the peak of the turn rate is given."""
        curvature = turn_rad_s / self._speed_m_s
        amplitude_m = min(_WEAVE_M, _WEAVE_SLOPE**2 / curvature)
        wave = math.sqrt(curvature / amplitude_m)
        x = np.arange(self._street.start_x, self._street.end_x, _WEAVE_STEP_M)
        return self._street.route(x, lateral + amplitude_m * np.sin(wave * x))

    def _things_at_rest(self, rng: np.random.Generator) -> Iterator[Body]:
        """Yields the bodies at rest."""
        edge_m = self._street.half_width_m
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
            back = drawn(_BACKS[self._place], rng)
            if back in _BACK_ROWS:
                maker, pitch_m, behind_m = _BACK_ROWS[back]
                if back in _FRONTS_M:
                    self._walls_m.append(side * (edge_m + _FRONTS_M[back]))
                yield from self._row((maker,), side * (edge_m + behind_m), pitch_m, rng)

    def _conditions(self, draws: Draws) -> Iterator[Body]:
        """Yields smooth walls, kerbs and the own body."""
        if "walls" in draws and self._place != "tunnel":
            walls_m = min(self._street.half_width_m, _ON_SQUARE_M) + _SMOOTH_WALL_M
            self._walls_m = [walls_m - 0.1, 0.1 - walls_m]
            for lateral in (walls_m, -walls_m):
                yield from self._row((models.smooth_wall,), lateral, 12.5, draws["walls"], 0.8)
        if "kerbs" in draws:
            yield from self._row((models.kerb,), 0.0, 12.0, draws["kerbs"], 0.8)
        if "body" in draws:
            yield Body(models.own_body(draws["body"]), self._ego)

    def _is_free(self, body: Body) -> bool:
        """Whether nothing is in its way; if so, it is in the way of others from now on."""
        pose = body.world_from_body(0.0)
        forward = np.array([pose[:2, 3], pose[:2, 3] + pose[:2, 0]])
        trip = Trip(Route.through(forward), SpeedProfile.steady(0.0), 0.0)
        return self._clearance.accept((trip, body.model.length_m, body.model.width_m))

    def _row(
        self,
        makers: Sequence[Maker],
        lateral: float,
        pitch_m: float,
        rng: np.random.Generator,
        share: float = 1.0,
    ) -> Iterator[Body]:
        turn = math.pi if lateral < 0 else 0.0
        for x in np.arange(self._street.start_x, self._street.end_x, pitch_m).tolist():
            model, is_there = _one_of(makers, rng), rng.uniform() < share
            if is_there and self._street.clear_of_crossings(x, _CLEAR_OF_CROSSING_M):
                yield Body(model, self._street.pose(x, lateral, turn))

    def _scattered(self, rng: np.random.Generator) -> Iterator[Body]:
        for _ in range(int(rng.integers(5, 40))):
            model = _one_of(_ON_SQUARE, rng)
            x, lateral, turn = rng.uniform((-60.0, -22.0, -3.0), (90.0, 22.0, 3.0))
            body = Body(model, self._street.pose(x, lateral, turn))
            if self._is_free(body):
                yield body


def _one_of(makers: Sequence[Maker], rng: np.random.Generator) -> Model:
    """Returns a specimen of one of the models."""
    return makers[int(rng.integers(len(makers)))](rng)
