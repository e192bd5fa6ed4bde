# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps cut by time: which points were seen a second time, and objects at their own times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_sweeps import Turning

from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.geometry.transforms import tilt
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps.sweep_clock import SweepClock

STREET = SimulationSettings(seed=1, duration_s=2.0, num_beams=32, num_columns=1000)


def turning_points(degrees, number=4000, first_s=0.0):
    """Points on a circle and their times, as a lidar that turns clockwise measures them."""
    turns = np.linspace(0, degrees / 360, number, endpoint=False)
    angles = -2 * np.pi * turns
    xyz = np.stack([10 * np.cos(angles), 10 * np.sin(angles), np.zeros(number)], axis=1)
    times_s = first_s + 0.1 * turns / turns[-1]
    return xyz.astype(np.float32), times_s.astype(np.float32)


class TestClock:
    @pytest.mark.parametrize("degrees", [300.0, 360.0, 395.0])
    @pytest.mark.parametrize("first_s", [0.0, -0.1])
    def test_knows_when_a_direction_was_measured_first(self, degrees, first_s):
        xyz, times_s = turning_points(degrees, first_s=first_s)
        clock = SweepClock.of(xyz, times_s)
        own = ~clock.is_again
        np.testing.assert_allclose(clock.times_of(2 * xyz[own]), times_s[own], atol=3e-4)
        assert clock.is_again.mean() == pytest.approx(max(0, 1 - 360 / degrees), abs=0.002)

    def test_of_a_tilted_lidar_goes_by_the_azimuth_about_its_own_axis(self):
        xyz, times_s = turning_points(360.0)
        xyz[:, 2] = np.random.default_rng(0).uniform(-4, 4, len(xyz))
        beams_from_sensor = tilt(np.deg2rad(30.0), 0.0)[:3, :3]
        seen = turned(xyz, beams_from_sensor.T)
        clock = SweepClock.of(seen, times_s, beams_from_sensor)
        found_s = clock.times_of(2 * seen)
        # At the seam, rounding decides.
        np.testing.assert_allclose(found_s[10:-10], times_s[10:-10], atol=3e-4)

    def test_knows_the_time_of_a_revolution(self):
        clock = SweepClock.of(*turning_points(395.0))
        assert clock.revolution_s == pytest.approx(0.1 * 360 / 395, abs=3e-4)

    @pytest.mark.parametrize("degrees", [360.0, 395.0])
    def test_times_that_lost_packets_set_to_0_tell_no_direction(self, degrees):
        xyz, times_s = (np.concatenate([part] * 25) for part in turning_points(degrees))
        is_lost = np.random.default_rng(0).random(len(xyz)) < 0.03
        clock = SweepClock.of(xyz, np.where(is_lost, np.float32(0), times_s))
        # Within 5 degrees of the start nobody can tell.
        inside = ~is_lost & ((xyz[:, 0] < 0) | (np.abs(xyz[:, 1]) > 1))
        again = SweepClock.of(xyz, times_s).is_again
        np.testing.assert_array_equal(clock.is_again[inside], again[inside])
        own = inside & ~again
        np.testing.assert_allclose(clock.times_of(xyz[own]), times_s[own], atol=3e-4)

    def test_of_directions_without_points_is_that_of_the_nearest(self):
        xyz, times_s = turning_points(360.0)
        ahead = xyz[:, 0] > 0
        clock = SweepClock.of(xyz[ahead], times_s[ahead])
        behind = np.array([[-5, -0.1, 0], [-5, 0.1, 0]], np.float32)
        np.testing.assert_allclose(clock.times_of(behind), [0.025, 0.075], atol=1e-3)

    @pytest.mark.parametrize("number", [0, 1, 3000])
    def test_there_is_none_of_a_lidar_that_does_not_turn(self, number):
        rng = np.random.default_rng(0)
        xyz = rng.uniform(-10, 10, (number, 3)).astype(np.float32)
        clock = SweepClock.of(xyz, rng.uniform(0, 0.1, number).astype(np.float32))
        assert clock is None or number == 1

    @pytest.mark.parametrize("turns", [True, False])
    @pytest.mark.parametrize("later_s", [0.02, 0.05, 0.08])
    def test_there_is_none_of_two_lidars_in_one_cloud(self, turns, later_s):
        """The second lidar sees nothing again: its points are of objects as those of the first."""
        xyz, times_s = turning_points(360.0)
        first_s = times_s if turns else np.zeros_like(times_s)
        both_s = np.concatenate([first_s, first_s + np.float32(later_s)])
        clock = SweepClock.of(np.concatenate([xyz, 0.8 * xyz]), both_s)
        assert clock is None or not clock.is_again.any()


class TestSeam:
    @pytest.fixture(scope="class")
    def street(self):
        turning = Turning(SweepSimulator(STREET), degrees=395.0)
        return [turning.sweep(index) for index in range(12)]

    def errors_of(self, street, sweeps):
        """End point errors of dynamic points, and which of them were seen again."""
        estimator, errors_m, again = make_method("online", preset("online")), [], []
        for index in range(1, len(sweeps) - 1):
            found = estimator.estimate(SweepTriplet(*sweeps[index - 1 : index + 2]))
            true = street[index]
            wanted = true.dynamic & ~true.ground
            errors_m.append(end_point_errors(found.flow, true.flow)[wanted])
            clock = SweepClock.of(true.sweep.xyz, true.sweep.times_s)
            again.append(clock.is_again[wanted])
        return np.concatenate(errors_m[5:]), np.concatenate(again[5:])

    def test_objects_move_by_their_own_times(self, street):
        sweeps = [item.sweep for item in street]
        timed_m, again = self.errors_of(street, sweeps)
        untimed_m, _ = self.errors_of(street, [replace(sweep, times_s=None) for sweep in sweeps])
        assert timed_m.mean() < 0.6 * untimed_m.mean()
        # What was seen again belongs to no object; it moves with the mover that it is a view of.
        assert timed_m[again].mean() < 0.7 * untimed_m[again].mean()
