# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a lidar turns is seen without times of points, where it passes things."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import BoxStreet, pose

from mnsf_ros.input_check.lidar_rotation import LidarRotation
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate


def drive(speed_m_s):
    return [
        BoxStreet().bent_sweep(lambda n: pose(0.1 * speed_m_s * n - 15.0), n) for n in range(20)
    ]


def rotation(speed_m_s, *, is_corrected):
    """What the sweeps show without their times, as measured or as a driver corrects them."""
    mounting = MountingEstimate()
    found = LidarRotation(Settings().ego_motion, mounting)
    for number, (sweep, straight) in enumerate(drive(speed_m_s)):
        xyz = straight.astype(np.float32) if is_corrected else sweep.xyz
        own = mounting.mounted(replace(sweep, xyz=xyz, times_s=None), Settings())
        found.add(Located(own, pose(0.1 * speed_m_s * number), "registration"))
    return found.find()


@pytest.mark.parametrize("is_corrected", [False, True])
def test_only_clouds_that_are_not_corrected_turn(is_corrected):
    found = rotation(15.0, is_corrected=is_corrected)
    if is_corrected:
        assert found is None
    else:
        assert found.times.is_clockwise
        assert found.off_m < 0.9 * found.off_without_m


def test_a_slow_sensor_shows_nothing():
    assert rotation(1.0, is_corrected=False) is None


def test_times_go_once_around_with_the_middle_at_the_stamp():
    xyz = np.float32([[-1, 0.01, 0], [0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, -0.01, 0]])
    times_s = AzimuthTimes(True, 180.0).of(xyz, 0.1)
    np.testing.assert_allclose(times_s, [-0.05, -0.025, 0.0, 0.025, 0.05], atol=2e-4)
    np.testing.assert_allclose(AzimuthTimes(False, 180.0).of(xyz, 0.1), -times_s, atol=2e-4)
