# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rooms in a row along x, with doorways between, and one of them a hall.

The lidar goes from room to room, from x = 0 on, in arcs that pass the middles of the doorways.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mnsf_ros.arrays import AnyFloats
from mnsf_ros.geometry.transforms import planar_pose
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Maker, Model, box
from mnsf_ros.simulation.routes import Clearance, Route, SensorTrip, SpeedProfile, Trip
from mnsf_ros.simulation.scene import Scene
from mnsf_ros.simulation.sensor import Sensor
from mnsf_ros.simulation.settings import SimulationSettings, drawn
from mnsf_ros.simulation.street import Centerline, Street
from mnsf_ros.simulation.traffic import standing_start, walk

# Half of the view (degrees) and number of beams.
_VIEWS: Final = {(15.0, 16): 0.3, (25.0, 32): 0.3, (45.0, 32): 0.2, (45.0, 128): 0.2}
_THICK_M: Final = 0.2
_DOOR_TOP_M: Final = 2.1
_BEHIND_M, _AHEAD_M = 2.0, 12.0
# Of all that carries the lidar, and how far things are from its way and from walls.
_EGO_LENGTH_M, _EGO_WIDTH_M = 0.8, 0.6
_FREE_M: Final = 0.9
_APART_M: Final = 0.05
_STEP_M: Final = 0.1
_AREA_OF_A_THING_M2: Final = 6.0
_THINGS: Final[Mapping[Maker, float]] = {models.shelf: 0.5, models.table: 0.3, models.column: 0.2}
# People who would meet something are left out.
_MOST_TRIES: Final = 9
_FROM_WALLS_M: Final = 0.5
_ROUTE_POINTS: Final = 50
# Sway of a robot on its wheels and of a lidar in the hand: pitch and roll (rad), heave (m).
_ON_WHEELS: Final = (0.002, 0.002, 0.002)
_IN_HAND: Final = (0.08, 0.06, 0.03)
_STRIDE_HZ: Final = (1.5, 2.1)
# Yaw of a lidar in the hand; at most 60 degrees within a tenth of a second.
_SWING_DEG, _SWING_HZ = (10.0, 95.0), (0.3, 1.0)


@dataclass(frozen=True)
class _Room:
    """The inside of a room, metres; the way bends by `bend_m` to the left within it."""

    x: tuple[float, float]
    y: tuple[float, float]
    height_m: float
    door_m: float  # width of the doorway at its end
    bend_m: float

    @property
    def area_m2(self) -> float:
        """Of its floor."""
        return (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])

    def way(self, x: AnyFloats) -> AnyFloats:
        """Returns y of the way at (T,) x; it is straight in doorways."""
        low, high = self.x
        return self.bend_m * np.sin(math.pi * (x - low) / (high - low)) ** 2


def rooms_scene(
    settings: SimulationSettings,
    lidar: np.random.Generator,
    place: np.random.Generator,
    people: np.random.Generator,
) -> Scene:
    """Returns a scene of rooms: each part is drawn from its own generator."""
    sensor = _sensor(lidar, is_fixed=settings.directions == "fixed")
    speed_m_s = place.uniform(0.5, 1.5)
    rooms = list(_rooms(settings.duration_s * speed_m_s + _AHEAD_M, place))
    ego = _moving_lidar(settings, rooms, speed_m_s, place)
    clearance = Clearance(settings.duration_s + 1.0, margin_m=_APART_M)
    clearance.accept((ego.trip, _EGO_LENGTH_M, _EGO_WIDTH_M))
    bodies = [*_shells(rooms), *_things(rooms, clearance, place)]
    walkers = list(_walkers(rooms, settings.duration_s, clearance, people))
    floor = Street(Centerline(0.0, 100.0, 0.0), rooms[0].x[0], rooms[-1].x[1], (), 1000.0)
    carrier = "by hand" if settings.scenario == "carried" else "on a robot"
    text = (
        f"{sensor.kind}, {sensor.rate_hz:g} Hz; {len(rooms)} rooms; {carrier}, "
        f"{speed_m_s:.1f} m/s; {len(walkers)} people"
    )
    return Scene(floor, (*bodies, *walkers), ego, sensor, text)


def _sensor(rng: np.random.Generator, *, is_fixed: bool) -> Sensor:
    half_deg, num_beams = drawn(_VIEWS, rng)
    return Sensor(
        kind=f"{num_beams} beams, ±{half_deg:g}°",
        elevations_deg=np.linspace(-half_deg, half_deg, num_beams),
        num_columns=drawn({640: 0.3, 1024: 0.7}, rng),
        rate_hz=10.0,
        range_noise_m=rng.uniform(0.005, 0.02),
        dropout=rng.uniform(0.0, 0.05),
        max_range_m=rng.uniform(60.0, 120.0),
        is_rolling=bool(rng.uniform() < 0.5),
        min_range_m=0.3,
        is_fixed=is_fixed,
    )


def _rooms(end_x: float, rng: np.random.Generator) -> Iterator[_Room]:
    """Yields rooms up to x; the first, second or third one is a hall."""
    x, number, hall = -_BEHIND_M, 0, int(rng.integers(3))
    while x < end_x or number <= hall:
        length_m, width_m, height_m = (
            rng.uniform((15.0, 9.0, 4.0), (30.0, 18.0, 6.0))
            if number == hall
            else rng.uniform((6.0, 4.0, 2.6), (10.0, 8.0, 3.5))
        ).tolist()
        left_m = width_m * rng.uniform(0.4, 0.6)
        door_m, bend_m = rng.uniform((1.0, -0.8), (1.6, 0.8)).tolist()
        # The lidar begins in the first room, on its straight way.
        bend_m = bend_m if number else 0.0
        yield _Room((x, x + length_m), (left_m - width_m, left_m), height_m, door_m, bend_m)
        x += length_m + _THICK_M
        number += 1


def _moving_lidar(
    settings: SimulationSettings,
    rooms: Sequence[_Room],
    speed_m_s: float,
    rng: np.random.Generator,
) -> SensorTrip:
    route = _route(rooms)
    profile = SpeedProfile.steady(speed_m_s)
    if settings.stands_s:
        profile = standing_start(speed_m_s, settings.stands_s)
    trip = Trip.starting_at(route, profile, route.arc_nearest(0.0, 0.0))
    is_carried = settings.scenario == "carried"
    phases = rng.uniform(0.0, 2 * math.pi, 4)
    amplitudes = np.array(_IN_HAND if is_carried else _ON_WHEELS) * rng.uniform(0.4, 1.3)
    frequencies = rng.uniform(*_STRIDE_HZ) * np.array([0.5, 0.5, 1.0])
    sway = np.stack([amplitudes, frequencies, phases[:3]], axis=1)
    swing_deg, swing_hz = rng.uniform(*_SWING_DEG), rng.uniform(*_SWING_HZ)
    height_m = rng.uniform(0.9, 1.5) if is_carried else rng.uniform(0.3, 1.2)
    pitch, roll = rng.normal(0.0, 0.01, 2).tolist()
    swing = (math.radians(swing_deg), swing_hz, float(phases[3])) if is_carried else (0.0,) * 3
    return SensorTrip(trip, sway, (pitch, roll, height_m), swing)


def _route(rooms: Sequence[_Room]) -> Route:
    """The way through all rooms."""
    parts = []
    for room in rooms:
        x = np.arange(room.x[0], room.x[1], _STEP_M)
        parts.append(np.stack([x, room.way(x)], axis=1))
    return Route.through(np.concatenate(parts))


def _shells(rooms: Sequence[_Room]) -> Iterator[Body]:
    """Yields walls and ceiling of each room; the last one has no doorway at its end."""
    for number, room in enumerate(rooms):
        (low, high), (right, left), top = room.x, room.y, room.height_m
        beside, above = (low - _THICK_M, high + _THICK_M), (top, top + _THICK_M)
        shapes = [
            box(beside, (left, left + _THICK_M), (0.0, top)),
            box(beside, (right - _THICK_M, right), (0.0, top)),
            box(beside, (right - _THICK_M, left + _THICK_M), above),
        ]
        if number == 0:
            shapes.append(box((low - _THICK_M, low), (right, left), (0.0, top)))
        # The wall to the next room closes the larger of both.
        following = rooms[min(number + 1, len(rooms) - 1)]
        right, left = min(right, following.y[0]), max(left, following.y[1])
        top, half_m = max(top, following.height_m), room.door_m / 2
        wall = (high, high + _THICK_M)
        if number == len(rooms) - 1:
            shapes.append(box(wall, (right, left), (0.0, top)))
        else:
            shapes += [
                box(wall, (half_m, left), (0.0, top)),
                box(wall, (right, -half_m), (0.0, top)),
                box(wall, (-half_m, half_m), (_DOOR_TOP_M, top)),
            ]
        model = Model(SurfaceClass.BUILDING, tuple(shapes), high - low, left - right, 90.0)
        yield Body(model, np.eye(4))


def _things(
    rooms: Sequence[_Room], clearance: Clearance, rng: np.random.Generator
) -> Iterator[Body]:
    """Yields shelves at walls, and tables and columns in the open, beside the way."""
    for room in rooms:
        for _ in range(round(room.area_m2 / _AREA_OF_A_THING_M2)):
            maker = drawn(_THINGS, rng)
            model = maker(rng)
            half_x, half_y = model.length_m / 2, model.width_m / 2
            (low, high), (right, left) = room.x, room.y
            x, y = rng.uniform((low + half_x, right + half_y), (high - half_x, left - half_y))
            if maker is models.shelf:
                y = rng.choice([left - half_y - _APART_M, right + half_y + _APART_M])
            way_m = room.way(np.linspace(x - half_x, x + half_x, 9))
            is_beside = np.abs(y - way_m).min() > half_y + _FREE_M
            if is_beside and clearance.accept((_still(x, y), model.length_m, model.width_m)):
                yield Body(model, planar_pose(x, y, 0.0))


def _still(x: float, y: float) -> Trip:
    """Something that stands along x."""
    ahead = Route.through(np.array([[x, y], [x + 1.0, y]]))
    return Trip(ahead, SpeedProfile.steady(0.0), 0.0)


def _walkers(
    rooms: Sequence[_Room], duration_s: float, clearance: Clearance, rng: np.random.Generator
) -> Iterator[Body]:
    """Yields people who stand, walk straight through a room and stand again."""
    for room in rooms:
        for _ in range(int(rng.integers(_MOST_TRIES))):
            low, high = np.array([room.x, room.y]).T
            begin, end = rng.uniform(low + _FROM_WALLS_M, high - _FROM_WALLS_M, (2, 2))
            route = Route.through(np.linspace(begin, end, _ROUTE_POINTS))
            trip = walk(route, rng.uniform(-3.0, 0.8 * duration_s), rng.uniform(0.6, 1.6))
            model = models.pedestrian(rng)
            if clearance.accept((trip, model.length_m, model.width_m)):
                yield Body(model, trip)
