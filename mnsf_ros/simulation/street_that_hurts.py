# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Movers that are hard to find: close to walls and parked cars, slow, stopping, flat-sided."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation import models
from mnsf_ros.simulation.roadside import parking_gaps
from mnsf_ros.simulation.routes import SpeedProfile, Trip
from mnsf_ros.simulation.street import FACADE_LATERAL_M, LANE_LATERAL_M, PARKING_LATERAL_M
from mnsf_ros.simulation.traffic import steady_trip

if TYPE_CHECKING:
    from mnsf_ros.simulation.street import Street
    from mnsf_ros.simulation.traffic import Traffic

# People between the wall and the street furniture, 0.65 m from the wall.
_WALL_LATERAL_M = FACADE_LATERAL_M - 0.65
# Scooters between the parked row and the driving lane.
_SCOOTER_LATERAL_M = PARKING_LATERAL_M - 1.55
_CURB_LATERAL_M = 8.0
_STEP_OUT_LATERAL_M = PARKING_LATERAL_M - 1.3
_SIDES = (1.0, -1.0)


def add_lorry(traffic: Traffic, ego: Trip, rng: np.random.Generator) -> None:
    """Adds a lorry that drives the ego vehicle's trip one lane to the left, a little behind."""
    route = traffic.street.lane(LANE_LATERAL_M, forward=True)
    x, y, _ = ego.planar(np.zeros(1))[0]
    start_m = route.arc_nearest(float(x), float(y))
    trips = (
        Trip(route, ego.profile, start_m + shift_m)
        for shift_m in rng.uniform(-4.0, 2.0) + np.array([0.0, -3.0, 3.0])
    )
    traffic.add_first_free(models.lorry(rng), trips)


def add_scooters(traffic: Traffic, reach_x: float, rng: np.random.Generator) -> None:
    """Adds scooters that overtake between the parked rows and the cars, on both sides."""
    for side in _SIDES:
        route = traffic.street.lane(side * _SCOOTER_LATERAL_M, forward=side < 0)
        start_x = -25.0 if side < 0 else 10.0
        for x in np.arange(start_x, reach_x + 60.0, 24.0):
            trips = (
                steady_trip(route, float(x) + shift, rng.uniform(8.0, 12.0))
                for shift in (0.0, 5.0, -5.0, 9.0)
            )
            traffic.add_first_free(models.scooter(rng), trips)


def add_people(traffic: Traffic, reach_x: float, rng: np.random.Generator) -> None:
    """Adds people who walk along the walls or slowly, or step out between parked cars."""
    duration_s = traffic.duration_s
    for x in parking_gaps(traffic.street):
        for side in _SIDES:
            if -10.0 < x < reach_x + 35.0 and rng.uniform() < 0.5:
                profile = _there_and_wait(rng.uniform(0.0, duration_s), rng.uniform(1.0, 2.0))
                trip = _step_out(traffic.street, float(x), side, profile)
                traffic.add_first_free(models.pedestrian(rng), [trip])
    for side in _SIDES:
        x = -15.0
        while x < reach_x + 40.0:
            lateral = side * rng.choice([_WALL_LATERAL_M, _WALL_LATERAL_M, 9.2])
            route = traffic.street.lane(lateral, forward=bool(rng.integers(2)))
            slow = rng.uniform() < 0.4
            speed = rng.uniform(0.3, 1.0) if slow else rng.uniform(1.0, 2.0)
            trip = steady_trip(route, x, speed)
            if rng.uniform() < 0.3:
                trip = replace(trip, profile=_now_and_then(speed, duration_s, rng))
            traffic.add_first_free(models.pedestrian(rng), [trip])
            x += 2.0 + float(rng.exponential(5.0))


def _step_out(street: Street, x: float, side: float, profile: SpeedProfile) -> Trip:
    """Returns a walk from the sidewalk between parked cars to the edge of the lane."""
    lateral = side * np.linspace(_CURB_LATERAL_M, _STEP_OUT_LATERAL_M, 30)
    return Trip(street.route(np.full(30, x), lateral), profile, 0.0)


def _there_and_wait(begin_s: float, speed_m_s: float) -> SpeedProfile:
    """Returns the speeds of a walk from `begin_s`, at rest before and after."""
    length_m = _CURB_LATERAL_M - _STEP_OUT_LATERAL_M
    end_s = begin_s + length_m / speed_m_s
    times_s = np.array([begin_s, begin_s + 0.3, end_s, end_s + 0.3])
    return SpeedProfile(times_s, speed_m_s * np.array([0.0, 1.0, 1.0, 0.0]))


def _now_and_then(speed_m_s: float, duration_s: float, rng: np.random.Generator) -> SpeedProfile:
    """Returns the speeds of a person who walks and stops in turn."""
    times_s, speeds_m_s = [0.0], [speed_m_s]
    for change_s, to_m_s in _changes(speed_m_s, duration_s, rng):
        times_s += [change_s, change_s + 0.3]
        speeds_m_s += [speeds_m_s[-1], to_m_s]
    return SpeedProfile(np.array(times_s), np.array(speeds_m_s))


def _changes(
    speed_m_s: float, duration_s: float, rng: np.random.Generator
) -> Iterator[tuple[float, float]]:
    time_s, is_walking = float(rng.uniform(0.2, 1.5)), True
    while time_s < duration_s + 1.0:
        is_walking = not is_walking
        yield time_s, speed_m_s if is_walking else 0.0
        time_s += float(rng.uniform(0.8, 1.8))


def scene_rng(seed: int) -> np.random.Generator:
    """Returns a separate generator: the usual street of a seed must not change."""
    return np.random.default_rng([seed, 2])
