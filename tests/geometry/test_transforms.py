# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid transforms: interpolation, inverse, and where a sensor is mounted."""

import numpy as np
import pytest
from box_street import pose

from mnsf_ros.geometry.transforms import (
    interpolated_pose,
    is_rigid,
    poses_from_quaternions,
    rigid_pose,
    sensor_mount,
)
from mnsf_ros.settings import EgoMotionSettings


@pytest.mark.parametrize("share", [0, 0.25, 0.5, 1, 1.5, -1])
def test_shift_and_turn_are_in_proportion_to_the_share(share):
    found = interpolated_pose(pose(1, yaw_deg=10), pose(3, yaw_deg=50), share)
    expected = pose(1 + 2 * share, yaw_deg=10 + 40 * share)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    # The shorter way round.
    found = interpolated_pose(pose(yaw_deg=170), pose(yaw_deg=-170), share)
    np.testing.assert_allclose(found, pose(yaw_deg=170 + 20 * share), atol=1e-12)


def test_sensor_is_turned_by_yaw_then_pitch_then_roll():
    sensor = sensor_mount(EgoMotionSettings(sensor_yaw_deg=90, sensor_pitch_deg=90))
    # Pitched by 90 degrees the sensor's x points down; its z is the old x, yawed to the left.
    np.testing.assert_allclose(sensor[:3, 0], (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(sensor[:3, 2], (0, 1, 0), atol=1e-12)
    sensor = sensor_mount(EgoMotionSettings(sensor_roll_deg=90))
    np.testing.assert_allclose(sensor[:3, 1], (0, 0, 1), atol=1e-12)


SCALED, MIRRORED = np.diag([2.0, 2, 2, 1]), np.diag([1.0, 1, -1, 1])
ODD = [np.diag([1, 1, 1, value]) for value in (np.nan, 2.0)]


@pytest.mark.parametrize("matrix", [np.zeros((4, 4)), np.eye(3), SCALED, MIRRORED, *ODD])
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
        with pytest.raises(ValueError, match=r"norm|reshape"):
            poses_from_quaternions(quaternion, position)
