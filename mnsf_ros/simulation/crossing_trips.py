"""Trips at a side street: straight over the main street, a right turn, a walk over the zebra."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation.routes import Route, SpeedProfile, Trip
from mnsf_ros.simulation.street import LANE_LATERAL_M, Crossing, Street

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mnsf_ros.geometry.transforms import FloatArray
    from mnsf_ros.simulation.ego import Stop

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
    """Return a drive along the side street that passes the main street's middle at `at_s`."""
    sign = 1.0 if toward_left else -1.0
    lateral = sign * np.arange(-_SIDE_REACH_M, _SIDE_REACH_M + _STEP_M, _STEP_M)
    x = np.full(len(lateral), crossing.x + sign * LANE_LATERAL_M)
    route = street.route(x, lateral)
    return Trip(route, SpeedProfile.steady(speed_m_s), _SIDE_REACH_M - speed_m_s * at_s)


def right_turn(
    street: Street, crossing: Crossing, at_s: float, main_speed_m_s: float, *, leaving: bool
) -> Trip:
    """Return a right turn of an oncoming car whose middle is at `at_s`.

    Args:
        street: The main street.
        crossing: Where the side street is.
        at_s: Time of the middle of the turn in seconds.
        main_speed_m_s: Speed on the main street, that of the oncoming stream.
        leaving: From the main street into the side street, otherwise the other way round.
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
    """Yield walks over the main street, from right to left, in front of the waiting ego vehicle.

    The person stands on the sidewalk before and after.
    """
    lateral = np.linspace(-_ZEBRA_END_LATERAL_M, _ZEBRA_END_LATERAL_M, 70)
    route = street.route(np.full(70, crossing.x + _ZEBRA_ALONG_M), lateral)
    to_ego_lane = _ZEBRA_END_LATERAL_M - LANE_LATERAL_M
    for speed in (1.5, 1.7, 1.9):
        for lead in (0.3, 0.0, -0.3, 0.6):
            begin = stop.begin_s + lead - to_ego_lane / speed
            yield Trip(route, _walk(begin, speed, route), 0.0)


def _walk(begin_s: float, speed_m_s: float, route: Route) -> SpeedProfile:
    """Return the speeds of a walk along the whole route from rest to rest."""
    end = begin_s + route.length_m / speed_m_s
    times: FloatArray = np.array([begin_s, begin_s + _STRIDE_S, end, end + _STRIDE_S])
    return SpeedProfile(times, speed_m_s * np.array([0.0, 1.0, 1.0, 0.0]))
