# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Everything that moves: cars in both directions, crossing and turning ones, cyclists, walkers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model
from mnsf_ros.simulation.routes import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    Clearance,
    Route,
    SpeedProfile,
    Stop,
    Trip,
)
from mnsf_ros.simulation.street import BICYCLE_LATERAL_M, LANE_LATERAL_M, Crossing, Street

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from mnsf_ros.geometry.transforms import FloatArray

_SIDE_REACH_M = 70.0
_STEP_M = 0.25
_TURN_RADIUS_M = 6.0
_TURN_SPEED_M_S = 4.0
_ZEBRA_ALONG_M = -7.0
_ZEBRA_END_LATERAL_M = 8.6
_STRIDE_S = 0.4


def straight_over(
    street: Street, crossing: Crossing, at_s: float, speed_m_s: float, *, toward_left: bool
) -> Trip:
    """Returns a drive along the side street that passes the main street's middle at `at_s`."""
    sign = 1.0 if toward_left else -1.0
    lateral = sign * np.arange(-_SIDE_REACH_M, _SIDE_REACH_M + _STEP_M, _STEP_M)
    x = np.full(len(lateral), crossing.x + sign * LANE_LATERAL_M)
    route = street.route(x, lateral)
    return Trip(route, SpeedProfile.steady(speed_m_s), _SIDE_REACH_M - speed_m_s * at_s)


def right_turn(
    street: Street, crossing: Crossing, at_s: float, main_speed_m_s: float, *, leaving: bool
) -> Trip:
    """Returns a right turn of an oncoming car whose middle is at `at_s` seconds.

    It leads from the main street, where the car goes with the oncoming stream, into the side street
    if it is `leaving`, otherwise the other way round.
    """
    center = LANE_LATERAL_M + _TURN_RADIUS_M
    main_reach = street.end_x - crossing.x if leaving else crossing.x - street.start_x
    main = np.arange(main_reach, center, -_STEP_M)
    side = np.arange(_SIDE_REACH_M, center, -_STEP_M)[::-1]
    angle = np.linspace(0.0, math.pi / 2, 40)
    shrinking = center - _TURN_RADIUS_M * np.sin(angle)
    lane = np.full(max(len(main), len(side)), LANE_LATERAL_M)
    along = np.concatenate([main, shrinking, lane[: len(side)]])
    lateral = np.concatenate([lane[: len(main)], shrinking[::-1], side])
    middle = len(main) + len(angle) // 2
    speeds = np.array([main_speed_m_s, _TURN_SPEED_M_S, _TURN_SPEED_M_S, 7.0])
    if not leaving:
        along, lateral, speeds = -along[::-1], lateral[::-1], speeds[::-1]
        middle = len(along) - 1 - middle
    route = street.route(crossing.x + along, lateral)
    profile = SpeedProfile(at_s + np.array([-3.0, -1.2, 1.2, 3.0]), speeds)
    traveled = float(profile.distances(np.array([at_s]))[0])
    return Trip(route, profile, float(route.arc_m[middle]) - traveled)


def zebra_walks(street: Street, crossing: Crossing, stop: Stop) -> Iterator[Trip]:
    """Yields walks over the main street, from right to left, in front of the waiting ego vehicle.

    The person stands on the sidewalk before and after.
    """
    lateral = np.linspace(-_ZEBRA_END_LATERAL_M, _ZEBRA_END_LATERAL_M, 70)
    route = street.route(np.full(70, crossing.x + _ZEBRA_ALONG_M), lateral)
    to_ego_lane = _ZEBRA_END_LATERAL_M - LANE_LATERAL_M
    for speed in (1.5, 1.7, 1.9):
        for lead in (0.3, 0.0, -0.3, 0.6):
            begin = stop.begin_s + lead - to_ego_lane / speed
            yield walk(route, begin, speed)


def walk(route: Route, begin_s: float, speed_m_s: float) -> Trip:
    """Returns a walk along the whole route from rest to rest."""
    end = begin_s + route.length_m / speed_m_s
    times: FloatArray = np.array([begin_s, begin_s + _STRIDE_S, end, end + _STRIDE_S])
    return Trip(route, SpeedProfile(times, speed_m_s * np.array([0.0, 1.0, 1.0, 0.0])), 0.0)


_SIDEWALK_LATERALS_M = (8.6, 9.2, 9.8)


class Traffic:
    """Fills a street with moving bodies that never run through each other or the ego vehicle.

    Attributes:
        bodies: The moving bodies so far.
        street: The street they move on.
        duration_s: Length of the recording in seconds.
    """

    def __init__(
        self, street: Street, ego: Trip, duration_s: float, rng: np.random.Generator
    ) -> None:
        """Starts with the ego vehicle alone on the street."""
        self.bodies: list[Body] = []
        self.street = street
        self._ego = ego
        self.duration_s = duration_s
        self._rng = rng
        self._oncoming_m_s = rng.uniform(6.5, 8.5)
        # One second more than recorded: the last sweeps' truth looks one interval ahead.
        self._clearance = Clearance(duration_s + 1.0)
        self._clearance.accept(ego, EGO_LENGTH_M, EGO_WIDTH_M)

    def add_crossing(self, crossing: Crossing, stop: Stop) -> None:
        """Adds the movers at a side street around the time the ego vehicle waits there."""
        rng, street = self._rng, self.street
        # In a recording that ends before the halt the crossing happens early, far ahead.
        middle = min((stop.begin_s + stop.end_s) / 2, 0.6 * self.duration_s)
        speeds = rng.uniform(6.0, 8.0, 2)
        shifts = rng.permutation(np.linspace(-2.0, 2.5, 12))
        leaving = bool(rng.integers(2))
        leftward = (
            straight_over(street, crossing, middle + shift, speeds[0], toward_left=True)
            for shift in (0.0, 0.3, -0.3, 0.6)
        )
        turns = (
            right_turn(street, crossing, middle + shift, self._oncoming_m_s, leaving=leaving)
            for shift in shifts
        )
        rightward = (
            straight_over(street, crossing, middle + shift, speeds[1], toward_left=False)
            for shift in shifts - 1.0
        )
        self.add_first_free(models.car(rng), leftward)
        self.add_first_free(models.pedestrian(rng), zebra_walks(street, crossing, stop))
        self.add_first_free(models.car(rng), turns)
        self.add_first_free(models.van(rng), rightward)

    def add_companions(self) -> None:
        """Adds cars that drive the ego vehicle's own trip some seconds earlier or later."""
        ego = self._ego
        for delay in (-5.5, 5.5, -10.5, 11.5):
            trips = (
                Trip(ego.route, ego.profile, ego.start_arc_m, delay * stretch)
                for stretch in (1.0, 1.15, 1.3)
            )
            self.add_first_free(models.car(self._rng), trips)

    def add_cyclists(self, reach_x: float) -> None:
        """Adds cyclists on both sides between the start and `reach_x` (metres)."""
        rng = self._rng
        for forward, first_x in ((True, 9.0), (False, 26.0)):
            lateral = -BICYCLE_LATERAL_M if forward else BICYCLE_LATERAL_M
            route = self.street.lane(lateral, forward=forward)
            for x in np.arange(first_x, reach_x + 10.0, 45.0):
                trips = (
                    steady_trip(route, float(x) + shift, rng.uniform(3.4, 4.8))
                    for shift in (0.0, 4.0, 8.0, -4.0)
                )
                self.add_first_free(models.cyclist(rng), trips)

    def add_oncoming(self, reach_x: float) -> None:
        """Adds a stream of oncoming cars long enough to meet the ego vehicle all the time."""
        rng, speed = self._rng, self._oncoming_m_s
        route = self.street.lane(LANE_LATERAL_M, forward=False)
        x, end = -50.0, reach_x + 60.0 + speed * self.duration_s
        while x < end:
            x += float(rng.uniform(13.0, 34.0))
            model = models.van(rng) if rng.uniform() < 0.15 else models.car(rng)
            self.add_first_free(
                model, [steady_trip(route, x + shift, speed) for shift in (0.0, 3.0, 6.0)]
            )

    def add_walkers(self, reach_x: float) -> None:
        """Adds people on both sidewalks from behind the start to beyond `reach_x` (metres)."""
        rng = self._rng
        for side in (1.0, -1.0):
            routes = [
                self.street.lane(side * lateral, forward=forward)
                for lateral in _SIDEWALK_LATERALS_M
                for forward in (True, False)
            ]
            x = -30.0
            while x < reach_x + 50.0:
                route = routes[int(rng.integers(len(routes)))]
                trip = steady_trip(route, x, rng.uniform(0.9, 1.6))
                self.add_first_free(models.pedestrian(rng), [trip])
                x += 0.8 + float(rng.exponential(7.0))

    def add_first_free(self, model: Model, trips: Iterable[Trip]) -> None:
        """Sends the model on the first trip that meets nothing; drops it if there is none."""
        for trip in trips:
            if self._clearance.accept(trip, model.length_m, model.width_m):
                self.bodies.append(Body(model, trip))
                return


def steady_trip(route: Route, x: float, speed_m_s: float) -> Trip:
    """Returns a trip of constant speed that is at world x (metres) at time 0."""
    index = int(np.argmin(np.abs(route.points[:, 0] - x)))
    ahead = (x - float(route.points[index, 0])) * math.copysign(1.0, math.cos(route.yaw[index]))
    return Trip(route, SpeedProfile.steady(speed_m_s), float(route.arc_m[index]) + ahead)
