"""Everything that moves: cars in both directions, crossing and turning ones, cyclists, walkers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model
from mnsf_ros.simulation.clearance import Clearance
from mnsf_ros.simulation.crossing_trips import right_turn, straight_over, zebra_walks
from mnsf_ros.simulation.ego import EGO_LENGTH_M, EGO_WIDTH_M, Stop
from mnsf_ros.simulation.routes import Route, SpeedProfile, Trip
from mnsf_ros.simulation.street import BICYCLE_LATERAL_M, LANE_LATERAL_M, Crossing, Street

if TYPE_CHECKING:
    from collections.abc import Iterable

_SIDEWALK_LATERALS_M = (8.6, 9.2, 9.8)


class Traffic:
    """Fills a street with moving bodies that never run through each other or the ego vehicle."""

    def __init__(
        self, street: Street, ego: Trip, duration_s: float, rng: np.random.Generator
    ) -> None:
        """Start with the ego vehicle alone on the street."""
        self.bodies: list[Body] = []
        self._street = street
        self._ego = ego
        self._duration_s = duration_s
        self._rng = rng
        self._oncoming_m_s = rng.uniform(6.5, 8.5)
        # One second more than recorded: the last sweeps' truth looks one interval ahead.
        self._clearance = Clearance(duration_s + 1.0)
        self._clearance.accept(ego, EGO_LENGTH_M, EGO_WIDTH_M)

    def add_crossing(self, crossing: Crossing, stop: Stop) -> None:
        """Add what moves at a side street around the time the ego vehicle waits there."""
        rng, street = self._rng, self._street
        # In a recording that ends before the halt the crossing happens early, far ahead.
        middle = min((stop.begin_s + stop.end_s) / 2, 0.6 * self._duration_s)
        speeds = rng.uniform(6.0, 8.0, 2)
        shifts = rng.permutation(np.linspace(-2.0, 2.5, 12))
        leaving = bool(rng.integers(2))
        self._first_free(
            models.car(rng),
            (
                straight_over(street, crossing, middle + shift, speeds[0], toward_left=True)
                for shift in (0.0, 0.3, -0.3, 0.6)
            ),
        )
        self._first_free(models.pedestrian(rng), zebra_walks(street, crossing, stop))
        self._first_free(
            models.car(rng),
            (
                right_turn(street, crossing, middle + shift, self._oncoming_m_s, leaving=leaving)
                for shift in shifts
            ),
        )
        self._first_free(
            models.van(rng),
            (
                straight_over(street, crossing, middle + shift, speeds[1], toward_left=False)
                for shift in shifts - 1.0
            ),
        )

    def add_companions(self) -> None:
        """Add cars that drive the ego vehicle's own trip some seconds earlier or later."""
        ego = self._ego
        for delay in (-5.5, 5.5, -10.5, 11.5):
            trips = (
                Trip(ego.route, ego.profile, ego.start_arc_m, delay * stretch)
                for stretch in (1.0, 1.15, 1.3)
            )
            self._first_free(models.car(self._rng), trips)

    def add_cyclists(self, reach_x: float) -> None:
        """Add cyclists on both sides between the start and `reach_x` (meters)."""
        rng = self._rng
        for forward, first_x in ((True, 9.0), (False, 26.0)):
            lateral = -BICYCLE_LATERAL_M if forward else BICYCLE_LATERAL_M
            route = self._street.lane(lateral, forward=forward)
            for x in np.arange(first_x, reach_x + 10.0, 45.0):
                trips = (
                    _steady_trip(route, float(x) + shift, rng.uniform(3.4, 4.8))
                    for shift in (0.0, 4.0, 8.0, -4.0)
                )
                self._first_free(models.cyclist(rng), trips)

    def add_oncoming(self, reach_x: float) -> None:
        """Add a stream of oncoming cars long enough to meet the ego vehicle all the time."""
        rng, speed = self._rng, self._oncoming_m_s
        route = self._street.lane(LANE_LATERAL_M, forward=False)
        x, end = -50.0, reach_x + 60.0 + speed * self._duration_s
        while x < end:
            x += float(rng.uniform(13.0, 34.0))
            model = models.van(rng) if rng.uniform() < 0.15 else models.car(rng)
            self._first_free(
                model, [_steady_trip(route, x + shift, speed) for shift in (0.0, 3.0, 6.0)]
            )

    def add_walkers(self, reach_x: float) -> None:
        """Add people on both sidewalks from behind the start to beyond `reach_x` (meters)."""
        rng = self._rng
        for side in (1.0, -1.0):
            routes = [
                self._street.lane(side * lateral, forward=forward)
                for lateral in _SIDEWALK_LATERALS_M
                for forward in (True, False)
            ]
            x = -30.0
            while x < reach_x + 50.0:
                route = routes[int(rng.integers(len(routes)))]
                trip = _steady_trip(route, x, rng.uniform(0.9, 1.6))
                self._first_free(models.pedestrian(rng), [trip])
                x += 0.8 + float(rng.exponential(7.0))

    def _first_free(self, model: Model, trips: Iterable[Trip]) -> None:
        """Send the model on the first trip that meets nothing; drop it if there is none."""
        for trip in trips:
            if self._clearance.accept(trip, model.length_m, model.width_m):
                self.bodies.append(Body(model, trip))
                return


def _steady_trip(route: Route, x: float, speed_m_s: float) -> Trip:
    """Return a trip of constant speed that is at world x (meters) at time 0."""
    index = int(np.argmin(np.abs(route.points[:, 0] - x)))
    ahead = (x - float(route.points[index, 0])) * math.copysign(1.0, math.cos(route.yaw[index]))
    return Trip(route, SpeedProfile.steady(speed_m_s), float(route.arc_m[index]) + ahead)
