# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scenes of staged scenarios, from their declarations."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray, planar_pose
from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model
from mnsf_ros.simulation.routes import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    Clearance,
    EgoMotion,
    Route,
    SpeedProfile,
    Trip,
    draw_sway,
)
from mnsf_ros.simulation.street import Centerline, Crossing, Street

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mnsf_ros.simulation.scenarios import ModelName, Mover, Row, Speeds, Stage, Way
    from mnsf_ros.simulation.settings import SimulationSettings

_STEP_M = 0.5
_CLEAR_OF_CROSSING_M = 14.0
# Movers and things at rest begin a little elsewhere with each seed.
_ALONG_M = 0.5
_MARGIN_M = 0.02


def staged_bodies(
    stage: Stage, settings: SimulationSettings
) -> tuple[Street, tuple[Body, ...], EgoMotion]:
    """Returns street, bodies and ego motion of a scenario; the same for equal settings."""
    statics, movers, ground = np.random.default_rng([settings.seed, 3]).spawn(3)
    crossings = () if stage.crossing_x is None else (Crossing(stage.crossing_x, 0.0, 0.0),)
    street = Street(Centerline(0.0, 1.0, 0.0), -60.0, 300.0, crossings, stage.road_half_width_m)
    ego = EgoMotion(_ego_trip(stage, settings.ego_speed_m_s), draw_sway(ground))
    clearance = Clearance(settings.duration_s + 1.0, margin_m=_MARGIN_M)
    clearance.accept(ego.trip, EGO_LENGTH_M, EGO_WIDTH_M)
    bodies = [body for row in stage.rows for body in _row(row, street, statics)]
    for mover in stage.movers:
        for model, trip in _trips(mover, movers):
            # Of two that would meet, the later one is left out.
            if clearance.accept(trip, model.length_m, model.width_m):
                bodies.append(Body(model, trip))
    return street, tuple(bodies), ego


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
