# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Covariances of chained poses, compared with what many noisy drives do."""

import itertools

import numpy as np
from box_street import BoxStreet, pose
from scipy.spatial.transform import Rotation

from mnsf_ros.ego_motion.covariance import StepNoise, chained_covariance, step_covariance
from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.settings import EgoMotionSettings

NOISE = StepNoise(0.01, 0.01, 0.002, 0.01)
ODOMETRY = EgoMotionSettings(source="odometry")


def test_chain_has_the_spread_of_many_noisy_drives():
    rng, motion = np.random.default_rng(0), pose(2, 0.1, yaw_deg=3, pitch_deg=1)
    step, num_steps, num_drives = step_covariance(motion, NOISE), 20, 4000
    covariance, true = np.zeros((6, 6)), np.eye(4)
    shifts, turns = np.zeros((num_drives, 3)), Rotation.identity(num_drives)
    for _ in range(num_steps):
        covariance = chained_covariance(covariance, true, motion, step)
        true = true @ motion
        noise = rng.multivariate_normal(np.zeros(6), step, num_drives)
        shifts = shifts + turns.apply(motion[:3, 3] + noise[:, :3])
        turns = turns * Rotation.from_rotvec(noise[:, 3:])
        turns = turns * Rotation.from_matrix(motion[:3, :3])
    errors = np.hstack(
        [shifts - true[:3, 3], (turns * Rotation.from_matrix(true[:3, :3]).inv()).as_rotvec()]
    )
    found = np.sqrt(np.diag(np.cov(errors.T)))
    expected = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found, expected, rtol=0.06)


def test_poses_say_how_uncertain_they_are():
    street, ego_motion = BoxStreet(), EgoMotion(EgoMotionSettings())
    found = [ego_motion.pose_of(street.sweep(pose(0.5 * index), index)) for index in range(4)]
    spreads = [np.sqrt(np.diag(item.covariance)) for item in found]
    assert (spreads[0] <= 0.001).all()
    assert (spreads[0] > 0).all()
    assert all((after > before).all() for before, after in itertools.pairwise(spreads))
    lost = ego_motion.pose_of(street.sweep(pose(2000.0), 4))
    assert np.sqrt(lost.step_covariance[0, 0]) > 0.1


def test_poses_say_that_little_holds_them_along_a_bare_tunnel():
    tunnel, ego_motion = BoxStreet(num_parked=0), EgoMotion(EgoMotionSettings())
    tunnel.boxes = [((0.0, side), (400.0, 3.0, 5.0)) for side in (-6.0, 6.0)]
    for index in range(4):
        found = ego_motion.pose_of(tunnel.sweep(pose(), index, points_per_box=60_000))
    along, across = np.sqrt(np.diag(found.step_covariance))[:2]
    assert along > 10 * across


def test_poses_on_bare_ground_are_guesses_that_go_on_with_the_velocity():
    """Flat ground looks the same from everywhere: the sensor may be metres from where it fits."""
    ground, ego_motion = BoxStreet(num_parked=0), EgoMotion(ODOMETRY)
    ground.boxes = []
    for index in range(6):
        known = pose(0.5 * index) if index < 3 else None
        found = ego_motion.pose_of(ground.sweep(pose(0.5 * index), index, odometry=known))
    assert found.source is EgoSource.LOST
    np.testing.assert_allclose(found.world_from_sensor, pose(2.5), atol=1e-9)
    assert np.sqrt(found.step_covariance[0, 0]) > 0.3


def test_beside_a_bare_wall_the_motion_along_it_goes_on():
    """The map hardly says how far the sensor went; the motion before does, while it brakes."""
    wall, ego_motion = BoxStreet(num_parked=0), EgoMotion(ODOMETRY)
    wall.boxes = [((0.0, 6.0), (400.0, 3.0, 5.0))]
    places_m = np.cumsum(np.append(np.ones(4), np.arange(1.0, 0.5, -0.02)))  # 2 m/s^2
    found = []
    for index, x in enumerate(places_m):
        odometry = pose(x) if index < 4 else None
        sweep = wall.sweep(pose(x), index, odometry=odometry, points_per_box=20_000)
        found.append(ego_motion.pose_of(sweep))
    assert {item.source for item in found[4:]} == {EgoSource.REGISTRATION}
    for (before, after), true_m in zip(itertools.pairwise(found), np.diff(places_m), strict=True):
        step = np.linalg.inv(before.world_from_sensor) @ after.world_from_sensor
        assert abs(step[0, 3] - true_m) < 0.25
