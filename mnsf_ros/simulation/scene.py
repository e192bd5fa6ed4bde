# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The scene of a recording, and that of the scenario `street`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation.bodies import Body
from mnsf_ros.simulation.roadside import roadside_bodies
from mnsf_ros.simulation.routes import (
    EgoMotion,
    Trip,
    braking_distance,
    draw_sway,
    drive_with_stops,
)
from mnsf_ros.simulation.sensor import Sensor, knee_elevations_deg
from mnsf_ros.simulation.street import LANE_LATERAL_M, Centerline, Street
from mnsf_ros.simulation.traffic import Traffic

if TYPE_CHECKING:
    from mnsf_ros.simulation.settings import SimulationSettings

_MARGIN_M = 140.0
_STOP_LINE_M = 12.0
_CROSSING_SPACING_M = 160.0


@dataclass(frozen=True)
class Scene:
    """Street, everything on it, and the vehicle with its lidar.

    `text` says in a line what was drawn.
    """

    street: Street
    bodies: tuple[Body, ...]
    ego: EgoMotion
    sensor: Sensor
    text: str


def street_scene(settings: SimulationSettings) -> Scene:
    """Returns the scene of the scenario `street`: lanes, side streets, traffic and people."""
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
    kind = f"{settings.num_beams} beams"
    sensor = Sensor(
        kind,
        knee_elevations_deg(settings.num_beams),
        settings.num_columns,
        settings.rate_hz,
        settings.range_noise_m,
        settings.dropout,
        settings.max_range_m,
    )
    bodies = (*roadside_bodies(street, statics), *traffic.bodies)
    return Scene(street, bodies, ego, sensor, f"{kind}; street")


def _street(rng: np.random.Generator, speed_m_s: float, reach_x: float) -> Street:
    centerline = Centerline(
        rng.uniform(2.0, 3.2) * rng.choice([-1.0, 1.0]),
        rng.uniform(150.0, 180.0),
        rng.uniform(0.0, 2 * math.pi),
    )
    first = _STOP_LINE_M + speed_m_s * rng.uniform(3.5, 4.5) + braking_distance(speed_m_s)
    places = np.arange(first, max(reach_x, first) + 1.0, _CROSSING_SPACING_M)
    crossings = centerline.crossings(places)
    return Street(centerline, -_MARGIN_M, max(reach_x, first) + _MARGIN_M, crossings)
