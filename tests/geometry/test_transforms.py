# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid transforms: interpolation, inverse, and where a sensor is mounted."""

from __future__ import annotations

import numpy as np
import pytest
from box_street import pose

from mnsf_ros.geometry.transforms import (
    apply,
    interpolated_pose,
    invert,
    is_rigid,
    poses_from_quaternions,
    rigid_pose,
    sensor_mount,
)
from mnsf_ros.settings import EgoMotionSettings


class TestInterpolatedPose:
    def test_ends_are_the_two_poses(self):
        first, second = pose(1, 2, 3, yaw_deg=20), pose(4, 5, 6, yaw_deg=-40, pitch_deg=5)
        np.testing.assert_allclose(interpolated_pose(first, second, 0), first, atol=1e-12)
        np.testing.assert_allclose(interpolated_pose(first, second, 1), second, atol=1e-12)

    @pytest.mark.parametrize("share", [0.25, 0.5, 1.5, -1])
    def test_shift_and_turn_are_in_proportion(self, share):
        found = interpolated_pose(pose(1, yaw_deg=10), pose(3, yaw_deg=50), share)
        expected = pose(1 + 2 * share, yaw_deg=10 + 40 * share)
        np.testing.assert_allclose(found, expected, atol=1e-12)

    def test_turns_the_shorter_way(self):
        found = interpolated_pose(pose(yaw_deg=170), pose(yaw_deg=-170), 0.5)
        np.testing.assert_allclose(found, pose(yaw_deg=180), atol=1e-12)


class TestSensorMount:
    def test_angles_are_yaw_then_pitch_then_roll(self):
        sensor = sensor_mount(EgoMotionSettings(sensor_yaw_deg=90, sensor_pitch_deg=90))
        # Pitched by 90 degrees the sensor's x points down; its z is the old x, yawed to the left.
        np.testing.assert_allclose(sensor[:3, 0], (0, 0, -1), atol=1e-12)
        np.testing.assert_allclose(sensor[:3, 2], (0, 1, 0), atol=1e-12)

    def test_roll_turns_about_the_axis_ahead(self):
        sensor = sensor_mount(EgoMotionSettings(sensor_roll_deg=90))
        np.testing.assert_allclose(sensor[:3, 1], (0, 0, 1), atol=1e-12)


def test_inverse_takes_points_back():
    points = np.random.default_rng(0).normal(size=(20, 3))
    there = pose(1, 2, 3, yaw_deg=40, pitch_deg=-10)
    np.testing.assert_allclose(apply(invert(there), apply(there, points)), points, atol=1e-12)


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((4, 4)),
        np.eye(3),
        np.diag([2.0, 2, 2, 1]),
        np.diag([1.0, 1, -1, 1]),
        np.diag([1, 1, 1, np.nan]),
        np.diag([1, 1, 1, 2.0]),
    ],
)
def test_what_is_no_rigid_motion_is_refused(matrix):
    assert not is_rigid(matrix)
    with pytest.raises(ValueError, match=r"rigid|reshape"):
        rigid_pose(matrix)


def test_rigid_motion_of_float32_is_one():
    assert is_rigid(pose(1e4, 2, 3, yaw_deg=40, pitch_deg=-10).astype(np.float32))


def test_poses_from_quaternions():
    half = np.sqrt(0.5)
    found = poses_from_quaternions([half, 0, 0, half], [1, 2, 3])
    np.testing.assert_allclose(found, pose(1, 2, 3, yaw_deg=90), atol=1e-12)
    assert poses_from_quaternions(np.zeros((0, 4)), np.zeros((0, 3))).shape == (0, 4, 4)
    for quaternion, position in (([0, 0, 0, 0], [0] * 3), ([1, 0, 0], [0] * 3), ([1] * 4, [0])):
        with pytest.raises(ValueError, match=r"norm|quaternion"):
            poses_from_quaternions(quaternion, position)
