# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a lidar turns is seen without times of points, where it passes things."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import SENSOR_HEIGHT_M, BoxStreet, pose

from mnsf_ros.input_check.lidar_rotation import LidarRotation
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes

SETTINGS = replace(Settings().ego_motion, source="registration")
FLOOR_M = 0.4 - SENSOR_HEIGHT_M


def drive(speed_m_s):
    return [
        BoxStreet().bent_sweep(lambda n: pose(0.1 * speed_m_s * n - 15.0), n) for n in range(20)
    ]


@pytest.mark.parametrize("is_corrected", [False, True])
def test_only_clouds_that_are_not_corrected_turn(is_corrected):
    sweeps = [
        replace(sweep, xyz=straight.astype(np.float32) if is_corrected else sweep.xyz, times_s=None)
        for sweep, straight in drive(15.0)
    ]
    found = LidarRotation.of(sweeps, FLOOR_M, SETTINGS)
    if is_corrected:
        assert found.times is None
    else:
        assert found.times.is_clockwise
        assert found.least_m < 0.9 * found.as_is_m


def test_a_slow_sensor_shows_nothing():
    sweeps = [replace(sweep, times_s=None) for sweep, _ in drive(1.0)]
    assert LidarRotation.of(sweeps, FLOOR_M, SETTINGS) is None


def test_times_go_once_around_with_the_middle_at_the_stamp():
    xyz = np.float32([[-1, 0.01, 0], [0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, -0.01, 0]])
    times_s = AzimuthTimes(True, 180.0).of(xyz, 0.1)
    np.testing.assert_allclose(times_s, [-0.05, -0.025, 0.0, 0.025, 0.05], atol=2e-4)
    np.testing.assert_allclose(AzimuthTimes(False, 180.0).of(xyz, 0.1), -times_s, atol=2e-4)
