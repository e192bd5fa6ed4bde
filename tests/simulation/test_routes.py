# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from mnsf_ros.simulation.routes import Route, SpeedProfile, Trip, drive_with_stops


def circle(radius):
    angle = np.linspace(0.0, math.pi, 800)
    return Route.through(radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1))


def test_route_on_a_circle_turns_evenly():
    route = circle(20.0)
    assert route.length_m == pytest.approx(20 * math.pi, rel=1e-4)
    arc = np.linspace(1.0, 60.0, 50)
    poses = route.poses(arc)
    assert np.allclose(poses[:, 2], arc / 20.0, atol=1e-2)
    assert np.allclose(np.hypot(poses[:, 0], poses[:, 1] - 20.0), 20.0, atol=1e-3)


def test_route_is_straight_beyond_its_ends():
    route = Route.through(np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]]))
    assert np.allclose(route.poses(np.array([-5.0, 15.0]))[:, :2], [[-3.0, -4.0], [9.0, 12.0]])


def test_distance_is_the_integral_of_speed():
    profile = SpeedProfile(np.array([0.0, 2.0, 3.0, 6.0]), np.array([8.0, 8.0, 0.0, 5.0]))
    times = np.linspace(-2.0, 9.0, 22001)
    speeds = np.interp(times, profile.times_s, profile.speeds_m_s)
    steps = np.diff(times) * (speeds[:-1] + speeds[1:]) / 2
    distances = profile.distances(times)
    assert np.allclose(np.diff(distances), steps, atol=1e-9)
    assert profile.distances(np.array([0.0, 1.0]))[[0, 1]] == pytest.approx([0.0, 8.0])


def test_delay_shifts_the_whole_trip():
    profile = SpeedProfile(np.array([0.0, 4.0]), np.array([3.0, 9.0]))
    early, late = (Trip(circle(50.0), profile, 5.0, delay) for delay in (0.0, 1.5))
    assert np.allclose(early.pose(2.0), late.pose(3.5))


def test_drive_halts_where_and_as_long_as_told():
    profile, stops = drive_with_stops(8.0, [50.0, 180.0], 1.5)
    for stop, distance in zip(stops, [50.0, 180.0], strict=True):
        halt = profile.distances(np.array([stop.begin_s, stop.end_s]))
        assert halt == pytest.approx([distance, distance])
        assert stop.end_s - stop.begin_s == pytest.approx(1.5)
    assert profile.speeds_m_s.max() == 8.0


def test_standing_vehicle_stays():
    profile, stops = drive_with_stops(0.0, [10.0], 1.0)
    assert np.all(profile.distances(np.array([0.0, 5.0, 50.0])) == 0.0)
    assert len(stops) == 1
