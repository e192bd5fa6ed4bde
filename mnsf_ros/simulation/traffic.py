# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Everything that moves: vehicles along and across the street, cyclists and people."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mnsf_ros.arrays import AnyFloats
from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Maker
from mnsf_ros.simulation.routes import Clearance, Route, SpeedProfile, Trip
from mnsf_ros.simulation.settings import Scenario, drawn
from mnsf_ros.simulation.street import LANE_LATERAL_M, Crossing, Street

_SIDE_REACH_M = 70.0
_STEP_M = 0.25
_TURN_RADIUS_M = 6.0
_TURN_SPEED_M_S = 4.0
_STRIDE_S = 0.4
_START_M_S2: Final = 3.0
# Breakpoints of a speed are apart, also where it stays 0.
_TINY_M_S: Final = 1e-6
# Movers that would meet something are left out; this many are tried for each that is wanted.
_TRIES: Final = 4


@dataclass(frozen=True)
class Kind:
    """Traffic of one kind: its share, models, speeds, and where it goes.

    Of several models each follows `behind_m` behind the one before, `beside_m` left of it.
    The default `name` is made of the names of its models.
    """

    share: float
    makers: tuple[Maker, ...]
    speeds_m_s: tuple[float, float]
    way: str
    behind_m: float = 0.0
    beside_m: float = 0.0
    name: str = ""


_KINDS: Final = (
    Kind(0.2, (models.car,), (2.0, 20.0), "lane"),
    Kind(0.06, (models.van,), (2.0, 18.0), "lane"),
    Kind(0.07, (models.lorry,), (1.0, 16.0), "lane"),
    Kind(0.03, (models.coach,), (2.0, 12.0), "lane"),
    Kind(
        share=0.03,
        makers=(models.bus_part, models.bus_part),
        speeds_m_s=(2.0, 10.0),
        way="lane",
        behind_m=9.0,
        name="articulated bus",
    ),
    Kind(0.03, (models.car, models.trailer), (2.0, 12.0), "lane", behind_m=4.2),
    Kind(0.08, (models.cyclist,), (2.0, 8.0), "edge"),
    Kind(0.06, (models.scooter,), (4.0, 14.0), "edge"),
    Kind(0.14, (models.pedestrian,), (0.5, 2.0), "sidewalk"),
    Kind(0.05, (models.pedestrian, models.child), (0.4, 1.6), "sidewalk", beside_m=0.5),
    Kind(0.03, (models.pedestrian, models.dog), (0.5, 3.0), "sidewalk", behind_m=0.9),
    Kind(0.08, (models.pedestrian,), (0.5, 2.5), "across"),
    Kind(0.03, (models.child,), (1.0, 3.5), "across"),
    Kind(0.02, (models.cyclist,), (2.0, 5.0), "sidewalk"),
    Kind(0.05, (models.car,), (3.0, 18.0), "side street"),
    Kind(0.04, (models.van,), (3.0, 5.0), "turn"),
)
# People who touch each other, and walls.
_GROUPS: Final = (
    Kind(0.15, (models.pedestrian,) * 3, (0.4, 1.6), "sidewalk", beside_m=0.42, name="group"),
    Kind(0.1, (models.pedestrian,) * 4, (0.4, 1.2), "sidewalk", behind_m=0.4, name="queue"),
    Kind(0.15, (models.pedestrian,) * 2, (0.4, 1.6), "wall", behind_m=0.45, name="pair at a wall"),
)
# Middle of a person from the wall.
_AT_WALL_M: Final = 0.3


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
    """Returns a right turn of a car whose middle is at `at_s` seconds.

    It leads from the oncoming lane of the main street into the side street if it is `leaving`,
    otherwise the other way round.
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


def walk(route: Route, begin_s: float, speed_m_s: float) -> Trip:
    """Returns a walk along the whole route from rest to rest."""
    end = begin_s + route.length_m / speed_m_s
    times: AnyFloats = np.array([begin_s, begin_s + _STRIDE_S, end, end + _STRIDE_S])
    return Trip(route, SpeedProfile(times, speed_m_s * np.array([0.0, 1.0, 1.0, 0.0])), 0.0)


@dataclass(frozen=True)
class Traffic:
    """Movers of a place."""

    scenario: Scenario  # what they are drawn from
    place: str  # its kind
    street: Street
    ego_speed_m_s: float  # of the vehicle with the lidar
    clearance: Clearance  # from all other things
    walls_m: tuple[float, ...]  # laterals of walls

    def drawn(self, rng: np.random.Generator) -> Iterator[tuple[str, list[Body]]]:
        """Yields movers that meet nothing, with the name of their kind."""
        kinds = (*_KINDS, *(_GROUPS if "groups" in self.scenario.conditions else ()))
        number, found = rng.poisson(drawn(self.scenario.numbers, rng)), 0
        for _ in range(_TRIES * number):
            kind = drawn({kind: kind.share for kind in kinds}, rng)
            first = self._trip(kind, rng)
            if first is None:
                continue
            trips = [first]
            for place in range(1, len(kind.makers)):
                beside = first.route.beside(place * kind.beside_m)
                start_m = first.start_arc_m - place * kind.behind_m
                trips.append(replace(first, route=beside, start_arc_m=start_m))
            group = [(maker(rng), trip) for maker, trip in zip(kind.makers, trips, strict=True)]
            rectangles = ((trip, model.length_m, model.width_m) for model, trip in group)
            if self.clearance.accept(*rectangles):
                name = kind.name or " with ".join(maker.__name__ for maker in kind.makers)
                yield name, [Body(model, trip) for model, trip in group]
                found += 1
                if found == number:
                    return

    def _trip(self, kind: Kind, rng: np.random.Generator) -> Trip | None:
        """Returns a trip; None where there is no such way."""
        street, speed_m_s = self.street, rng.uniform(*kind.speeds_m_s)
        if kind.way in ("turn", "side street"):
            if not street.crossings:
                return None
            at_s, is_left = rng.uniform(-0.5, 3.0), bool(rng.integers(2))
            crossing = street.crossings[int(rng.integers(len(street.crossings)))]
            # Crossed when the lidar is as near to it as to the first crossing at the start.
            at_s += (crossing.x - street.crossings[0].x) / max(self.ego_speed_m_s, 1.0)
            if kind.way == "turn":
                return right_turn(street, crossing, at_s, speed_m_s, leaving=is_left)
            return straight_over(street, crossing, at_s, speed_m_s, toward_left=is_left)
        has_way = self.place != "tunnel" or kind.way not in ("sidewalk", "across")
        if not has_way or (kind.way == "wall" and not self.walls_m):
            return None
        if self.place != "square" and kind.way == "across":
            return self._walk_across(speed_m_s, rng)
        is_open = self.place == "square" and kind.way != "wall"
        route = self._open_way(rng) if is_open else self._way(kind.way, rng)
        if kind.way == "lane" and rng.uniform() < 0.4 and self.ego_speed_m_s > 1.0:
            speed_m_s = self.ego_speed_m_s * rng.uniform(0.7, 1.3)
        nearest_m, farthest_m = self.scenario.reach_m
        x, y = rng.uniform((nearest_m, -10.0), (farthest_m, 10.0))
        return Trip.starting_at(
            route, draw_profile(speed_m_s, self.scenario.behaviours, rng), route.arc_nearest(x, y)
        )

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
        elif way == "wall":
            wall_m = rng.choice(self.walls_m)
            lateral = wall_m - math.copysign(_AT_WALL_M, wall_m)
            forward = bool(rng.integers(2))
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


def draw_profile(
    speed_m_s: float, behaviours: Mapping[str, float], rng: np.random.Generator
) -> SpeedProfile:
    """Returns a speed that stays, falls to a stop, rises from one, or changes."""
    behaviour = drawn(behaviours, rng)
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


def standing_start(speed_m_s: float, stands_s: float) -> SpeedProfile:
    """Returns a profile that stands for some seconds, then accelerates to a speed."""
    ends_s = stands_s + max(speed_m_s, _TINY_M_S) / _START_M_S2
    return SpeedProfile(np.array([stands_s, ends_s]), np.array([0.0, speed_m_s]))
