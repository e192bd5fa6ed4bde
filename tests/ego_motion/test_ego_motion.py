# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses of a sensor on a street of boxes, by registration, by odometry, and when either is lost."""

import numpy as np
import pytest
from box_street import BoxStreet, angle_deg, distance_m, pose, unrelated_sweep

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.settings import EgoMotionSettings, Settings
from mnsf_ros.sweeps.sweep import Sweep

STREET = BoxStreet()
REGISTRATION = EgoMotionSettings()
ODOMETRY = Settings().changed({"ego_motion.source": "odometry"}).ego_motion

# The world of the odometry has nothing to do with that of the sweeps.
ODOMETRY_WORLD = pose(200, -50, 3, yaw_deg=70)


def moved(step_m=0.6, turn_deg=1.0):
    """Number of a sweep to true pose; the sensor drives with constant speed and turn rate."""
    return lambda index: np.linalg.matrix_power(pose(step_m, 0.1, yaw_deg=turn_deg), index)


def sweep_at(path, index, *, with_odometry=False, error_m=0.0, **how):
    """The sweep of a number; its odometry is as wrong as told, in the direction of x."""
    if with_odometry:
        how["odometry"] = ODOMETRY_WORLD @ pose(error_m) @ path(index)
    return STREET.sweep(path(index), index, **how)


def assert_near(found, expected, within_m=0.01, within_deg=0.1):
    assert distance_m(found, expected) < within_m
    assert angle_deg(found, expected) < within_deg


def poses_of(ego_motion, sweeps):
    return [ego_motion.pose_of(sweep) for sweep in sweeps]


class TestRegistration:
    @pytest.mark.parametrize(
        "path",
        [moved(0, 0), moved(0.6, 1), moved(1.5, -2), moved(-0.5, 0), moved(0, 4)],
        ids=["standing", "city", "curve", "backward", "turning on the spot"],
    )
    def test_finds_the_motion_within_a_centimetre(self, path):
        found = poses_of(EgoMotion(REGISTRATION), [sweep_at(path, index) for index in range(5)])
        assert [item.source for item in found] == [EgoSource.START] + 4 * [EgoSource.REGISTRATION]
        for index, item in enumerate(found):
            assert_near(item.world_from_sensor, path(index))

    @pytest.mark.parametrize("seed", range(4))
    @pytest.mark.parametrize("step_m", [3.0, -3.0, 4.0])
    def test_finds_a_first_motion_that_nobody_expects(self, seed, step_m):
        """3 m a sweep are 108 km/h: from the last place alone half of the streets mislead it."""
        street, ego_motion = BoxStreet(seed), EgoMotion(REGISTRATION)
        for index in range(3):
            found = ego_motion.pose_of(street.sweep(pose(step_m * index), index))
        assert_near(found.world_from_sensor, pose(2 * step_m))

    def test_expects_the_motion_of_the_time_that_went_by(self):
        """Sweeps that are left out make no difference: velocity is constant, not the step."""
        path = moved(2.0, 1.5)
        ego_motion = EgoMotion(REGISTRATION)
        for index in (0, 1, 2, 4, 5, 8, 9):
            found = ego_motion.pose_of(sweep_at(path, index))
        assert found.source is EgoSource.REGISTRATION
        assert_near(found.world_from_sensor, path(9))

    @pytest.mark.parametrize(
        ("jump", "within_deg"),
        [
            (pose(0.3), 0.1),
            (pose(-0.3), 0.1),
            (pose(yaw_deg=2.0), 0.2),
            (pose(yaw_deg=-2.0), 0.2),
        ],
    )
    def test_follows_a_jump(self, jump, within_deg):
        """As of stamps that are off, 30 ms at 10 m/s, and in a turn."""
        for seed in range(4):
            street, ego_motion = BoxStreet(seed), EgoMotion(REGISTRATION)
            for index in range(8):
                truth = pose(0.3 * index) @ (jump if index > 4 else np.eye(4))
                found = ego_motion.pose_of(street.sweep(truth, index))
                assert_near(found.world_from_sensor, truth, 0.04, within_deg)

    def test_follows_who_drives_off(self):
        """With 4 m/s^2, twice the usual standard deviation."""
        for seed in range(4):
            street, ego_motion = BoxStreet(seed), EgoMotion(REGISTRATION)
            for index in range(14):
                truth = pose(0.02 * max(index - 4, 0) ** 2)
                found = ego_motion.pose_of(street.sweep(truth, index))
                assert_near(found.world_from_sensor, truth, 0.02)

    def test_finds_tilt_and_climb(self):
        ego_motion = EgoMotion(REGISTRATION)
        truth = pose(0.5, 0, 0.05, pitch_deg=1.5)
        for sweep in (STREET.sweep(pose(), 0), STREET.sweep(truth, 1)):
            found = ego_motion.pose_of(sweep)
        assert_near(found.world_from_sensor, truth)


def with_few_points(index, num_points):
    whole = sweep_at(moved(), index)
    return Sweep(whole.xyz[:num_points], whole.stamp_ns, whole.frame_id)


class TestWhatCannotBeRegistered:
    @pytest.mark.parametrize(
        ("bad", "num_lost"),
        [(with_few_points(3, 0), 1), (with_few_points(3, 40), 1), (unrelated_sweep(3), 2)],
        ids=["empty", "forty points", "another place"],
    )
    def test_goes_on_with_constant_velocity_until_the_map_fits_again(self, bad, num_lost):
        path, ego_motion = moved(0.6, 0), EgoMotion(REGISTRATION)
        poses_of(ego_motion, [sweep_at(path, index) for index in range(3)])
        found = [ego_motion.pose_of(bad)]
        found += poses_of(ego_motion, [sweep_at(path, index) for index in (4, 5, 6)])
        assert [item.source for item in found] == [
            *(num_lost * [EgoSource.LOST]),
            *((4 - num_lost) * [EgoSource.REGISTRATION]),
        ]
        for index, item in enumerate(found, start=3):
            assert_near(item.world_from_sensor, path(index), within_m=0.03)

    def test_of_a_longer_interval_goes_on_for_as_long(self):
        path, ego_motion = moved(0.6, 2), EgoMotion(REGISTRATION)
        poses_of(ego_motion, [sweep_at(path, index) for index in range(3)])
        found = ego_motion.pose_of(unrelated_sweep(4))
        step = np.linalg.inv(path(2)) @ found.world_from_sensor
        # Twice the time: twice as far and twice the turn.
        assert distance_m(step, np.eye(4)) == pytest.approx(2 * np.hypot(0.6, 0.1), abs=0.02)
        assert angle_deg(step, np.eye(4)) == pytest.approx(4, abs=0.1)

    def test_too_sparse_for_surfaces_is_no_registration(self):
        places = np.random.default_rng(0).uniform(-8, 8, (400, 3)).astype(np.float32)
        odometry = EgoMotion(EgoMotionSettings())
        for number in range(3):
            odometry.pose_of(Sweep(places + np.float32(0.3 * number), number * 10**8))
        pose = odometry.pose_of(Sweep(places + np.float32(0.9), 3 * 10**8))
        assert pose.source is EgoSource.LOST

    def test_points_far_away_and_far_up_are_no_harm(self):
        path, ego_motion = moved(), EgoMotion(REGISTRATION)
        far = np.array([[1e6, 0, 0], [0, -1e20, 0], [500, 500, 500]], np.float32)
        for index in range(3):
            sweep = sweep_at(path, index)
            more = Sweep(np.vstack([far, sweep.xyz]), sweep.stamp_ns, sweep.frame_id)
            found = ego_motion.pose_of(more)
        assert_near(found.world_from_sensor, path(2))


def test_stamps_may_be_equal():
    path, ego_motion = moved(), EgoMotion(REGISTRATION)
    for index in range(4):
        found = ego_motion.pose_of(Sweep(sweep_at(path, index).xyz))
    assert found.source is EgoSource.REGISTRATION
    assert_near(found.world_from_sensor, path(3))


class TestOdometry:
    def test_is_taken_as_it_is(self):
        """Wrong odometry shows that nothing else was used; only its motion counts."""
        ego_motion = EgoMotion(ODOMETRY)
        errors_m = [0.0, 0.1, 0.3]
        found = [
            ego_motion.pose_of(sweep_at(moved(), index, with_odometry=True, error_m=error_m))
            for index, error_m in enumerate(errors_m)
        ]
        assert [item.source for item in found] == [EgoSource.START] + 2 * [EgoSource.ODOMETRY]
        expected = pose(0.3) @ moved()(2)
        np.testing.assert_allclose(found[2].world_from_sensor, expected, atol=1e-9)

    def test_lost_and_found_makes_no_jump(self):
        ego_motion, path = EgoMotion(ODOMETRY), moved()
        has_odometry = [True] * 3 + [False] * 3 + [True] * 3
        found = [
            ego_motion.pose_of(sweep_at(path, index, with_odometry=known))
            for index, known in enumerate(has_odometry)
        ]
        words = [item.source for item in found]
        # Two poses make a motion: the first sweep with odometry again is still registered.
        assert words == [
            EgoSource.START,
            *(2 * [EgoSource.ODOMETRY]),
            *(4 * [EgoSource.REGISTRATION]),
            *(2 * [EgoSource.ODOMETRY]),
        ]
        for index, item in enumerate(found):
            assert_near(item.world_from_sensor, path(index))

    def test_that_starts_elsewhere_after_a_loss_makes_no_jump(self):
        ego_motion, path = EgoMotion(ODOMETRY), moved()
        for index in range(6):
            error_m = 0.0 if index < 3 else 1000.0
            sweep = sweep_at(path, index, with_odometry=index != 3, error_m=error_m)
            found = ego_motion.pose_of(sweep)
        assert found.source is EgoSource.ODOMETRY
        assert_near(found.world_from_sensor, path(5))

    @pytest.mark.parametrize("jump_m", [12.0, 1e200])
    def test_that_jumps_leaves_registration_for_one_sweep(self, jump_m):
        ego_motion, path = EgoMotion(ODOMETRY), moved()
        found = []
        for index in range(6):
            error_m = 0.0 if index < 3 else jump_m
            sweep = sweep_at(path, index, with_odometry=True, error_m=error_m)
            found.append(ego_motion.pose_of(sweep))
        is_jump = abs(jump_m) < 1e100
        words = [item.source for item in found]
        assert words[1:4] == [*(2 * [EgoSource.ODOMETRY]), EgoSource.REGISTRATION]
        if is_jump:
            assert words[4:] == 2 * [EgoSource.ODOMETRY]
            assert_near(found[-1].world_from_sensor, path(5))
        assert all(np.isfinite(item.world_from_sensor).all() for item in found)
