# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The whole scene of one recording, drawn from the seed: a street, or a staged scenario."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray, planar_pose
from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model
from mnsf_ros.simulation.roadside import roadside_bodies
from mnsf_ros.simulation.routes import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    Clearance,
    EgoMotion,
    Route,
    SpeedProfile,
    Trip,
    braking_distance,
    draw_sway,
    drive_with_stops,
)
from mnsf_ros.simulation.scenarios import STAGES, Sensor, Stage
from mnsf_ros.simulation.street import LANE_LATERAL_M, Centerline, Crossing, Street
from mnsf_ros.simulation.traffic import Traffic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mnsf_ros.simulation.scenarios import ModelName, Mover, Row, Speeds, Way
    from mnsf_ros.simulation.settings import SimulationSettings

_MARGIN_M = 140.0
_STOP_LINE_M = 12.0
_CROSSING_SPACING_M = 160.0
_STEP_M = 0.5
_CLEAR_OF_CROSSING_M = 14.0
# Movers of a stage begin a little elsewhere with each seed.
_ALONG_M = 0.5
_APART_M = 0.02


@dataclass(frozen=True)
class Scene:
    """Street, everything on it, the vehicle that carries the lidar, and how that sees."""

    street: Street
    bodies: tuple[Body, ...]
    ego: EgoMotion
    sensor: Sensor


def build_scene(settings: SimulationSettings, stage: Stage | None = None) -> Scene:
    """Returns the scene of a recording; equal settings give equal scenes.

    A stage takes the place of the scenario of the settings.
    """
    stage = stage or STAGES.get(settings.scenario)
    if stage is not None:
        return _staged_scene(stage, settings)
    # A generator of its own for each part: more cars do not change the houses.
    ground, statics, movers = np.random.default_rng([settings.seed, 0]).spawn(3)
    speed = settings.ego_speed_m_s
    reach_x = speed * settings.duration_s
    street = _street(ground, speed, reach_x)
    route = street.lane(-LANE_LATERAL_M, forward=True)
    start = route.arc_nearest(0.0, float(street.centerline.place(np.zeros(1), -2.0)[0, 1]))
    stop_lines = [
        route.arc_nearest(*street.centerline.place(np.array([c.x]), -LANE_LATERAL_M)[0]) - start
        for c in street.crossings
    ]
    profile, stops = drive_with_stops(
        speed, [line - _STOP_LINE_M for line in stop_lines], ground.uniform(1.0, 1.6)
    )
    trip = Trip(route, profile, start)
    ego = EgoMotion(trip, draw_sway(ground))
    traffic = Traffic(street, trip, settings.duration_s, movers)
    for crossing, stop in zip(street.crossings, stops, strict=True):
        traffic.add_crossing(crossing, stop)
    traffic.add_companions()
    traffic.add_cyclists(reach_x)
    traffic.add_oncoming(reach_x)
    traffic.add_walkers(reach_x)
    return Scene(street, (*roadside_bodies(street, statics), *traffic.bodies), ego, Sensor())


def _street(rng: np.random.Generator, speed_m_s: float, reach_x: float) -> Street:
    centerline = Centerline(
        rng.uniform(2.0, 3.2) * rng.choice([-1.0, 1.0]),
        rng.uniform(150.0, 180.0),
        rng.uniform(0.0, 2 * math.pi),
    )
    first = _STOP_LINE_M + speed_m_s * rng.uniform(3.5, 4.5) + braking_distance(speed_m_s)
    places = np.arange(first, max(reach_x, first) + 1.0, _CROSSING_SPACING_M)
    crossings = tuple(
        Crossing(float(x), float(y), float(heading))
        for x, y, heading in zip(
            places, centerline.offset(places), centerline.heading(places), strict=True
        )
    )
    return Street(centerline, -_MARGIN_M, max(reach_x, first) + _MARGIN_M, crossings)


def _staged_scene(stage: Stage, settings: SimulationSettings) -> Scene:
    statics, movers, ground = np.random.default_rng([settings.seed, 3]).spawn(3)
    crossings = () if stage.crossing_x is None else (Crossing(stage.crossing_x, 0.0, 0.0),)
    street = Street(Centerline(0.0, 1.0, 0.0), -60.0, 300.0, crossings, stage.road_half_width_m)
    ego = EgoMotion(_ego_trip(stage, settings.ego_speed_m_s), draw_sway(ground))
    clearance = Clearance(settings.duration_s + 1.0, margin_m=_APART_M)
    clearance.accept(ego.trip, EGO_LENGTH_M, EGO_WIDTH_M)
    bodies = [body for row in stage.rows for body in _row(row, street, statics)]
    for mover in stage.movers:
        for model, trip in _trips(mover, movers):
            # Of two that would meet, the later one is left out.
            if clearance.accept(trip, model.length_m, model.width_m):
                bodies.append(Body(model, trip))
    return Scene(street, tuple(bodies), ego, stage.sensor)


def _ego_trip(stage: Stage, speed_m_s: float) -> Trip:
    speeds = tuple((time_s, share * speed_m_s) for time_s, share in stage.ego_speeds)
    route = Route.through(_points(stage.ego, 20.0))
    at_start = route.arc_nearest(0.0, stage.ego[0][1])
    profile = _profile(speeds)
    before_first_m = float(profile.distances(np.zeros(1))[0])
    return Trip(route, profile, at_start - before_first_m)


def _profile(speeds: float | Speeds) -> SpeedProfile:
    pairs = ((0.0, speeds),) if isinstance(speeds, float) else speeds
    times_s, speeds_m_s = np.array(pairs).T
    return SpeedProfile(times_s, speeds_m_s)


def _trips(mover: Mover, rng: np.random.Generator) -> Iterator[tuple[Model, Trip]]:
    route, profile = Route.through(_points(mover.way, mover.radius_m)), _profile(mover.speeds)
    shift_m = rng.uniform(-_ALONG_M, _ALONG_M)
    for number in range(mover.count):
        at_m = mover.at_m + shift_m - number * mover.spacing_m
        yield _maker(mover.model)(rng), Trip(route, profile, at_m)


def _row(row: Row, street: Street, rng: np.random.Generator) -> Iterator[Body]:
    for x in np.arange(row.from_x, row.to_x, row.pitch_m):
        model, is_there = _maker(row.model)(rng), rng.uniform() < row.share
        if is_there and street.clear_of_crossings(float(x), _CLEAR_OF_CROSSING_M):
            yield Body(model, planar_pose(float(x), row.y, math.radians(row.turn_deg)))


def _maker(model: ModelName) -> Callable[[np.random.Generator], Model]:
    if model == "house":
        return partial(models.house, width_m=11.0)
    maker: Callable[[np.random.Generator], Model]
    maker = getattr(models, model) if isinstance(model, str) else model
    return maker


def _points(way: Way, radius_m: float) -> FloatArray:
    """Returns (M, 2) closely spaced points of a way with rounded corners."""
    corners = np.array(way)
    rounded = [corners[:1]]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        rounded.append(_bend(before, corner, after, radius_m))
    rounded.append(corners[-1:])
    coarse = np.concatenate(rounded)
    steps = np.hypot(*np.diff(coarse, axis=0).T)
    arc_m = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.arange(0.0, arc_m[-1], _STEP_M)
    return np.stack([np.interp(places, arc_m, coarse[:, axis]) for axis in range(2)], axis=1)


def _bend(before: FloatArray, corner: FloatArray, after: FloatArray, radius_m: float) -> FloatArray:
    """Returns (M, 2) points of the arc that replaces a corner."""
    first = (corner - before) / np.hypot(*(corner - before))
    last = (after - corner) / np.hypot(*(after - corner))
    turn = math.atan2(first[0] * last[1] - first[1] * last[0], float(first @ last))
    begin = corner - first * radius_m * math.tan(abs(turn) / 2)
    left = np.array([-first[1], first[0]])
    angles = np.linspace(0.0, abs(turn), 24)[:, None]
    sideways = math.copysign(1.0, turn) * (1.0 - np.cos(angles)) * left
    bend: FloatArray = begin + radius_m * (np.sin(angles) * first + sideways)
    return bend
