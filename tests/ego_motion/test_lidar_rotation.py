# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a lidar turns is seen without times of points, where it passes things."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from box_street import BoxStreet, pose

from mnsf_ros.ego_motion.ego_motion import EgoSource, SensorPose
from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes, times_in_order
from mnsf_ros.sweeps.sweep import Start, SweepTriplet


def drive(speed_m_s, *, is_corrected=False, is_reversed=False):
    """Yields sweeps as measured or corrected, points in order of their times, and their poses."""

    def path(number):
        return pose(0.1 * speed_m_s * number - 15.0)

    for number in range(20):
        sweep, straight = BoxStreet().bent_sweep(path, number)
        order = np.argsort(sweep.times_s, kind="stable")[:: -1 if is_reversed else 1]
        measured = replace(sweep, xyz=straight.astype(np.float32)) if is_corrected else sweep
        yield measured.part(order), SensorPose(path(number), EgoSource.REGISTRATION)


def rotation(speed_m_s, **how):
    """What the sweeps show without their times."""
    found = LidarRotation()
    sweeps = [(replace(sweep, times_s=None), at) for sweep, at in drive(speed_m_s, **how)]
    for last, newest in pairwise(sweeps):
        was_found = bool(found.is_found)
        is_news = found.learn(last, newest, Settings())
        assert is_news == (bool(found.is_found) and not was_found)
    return found


def test_times_follow_the_order_of_the_points_of_a_lidar_that_turns():
    found = rotation(15.0)
    assert found.is_found
    sweep, _ = next(drive(15.0))
    triplet = SweepTriplet(None, replace(sweep, times_s=None), sweep)
    timed = found.timed(triplet, Settings())
    assert timed.current is found.timed(triplet, Settings()).current
    assert timed.next is sweep
    assert np.median(np.abs(timed.current.times_s - (sweep.times_s - 0.05))) < 0.002
    for changes in ({"time.field": "none"}, {"ego_motion.deskew": False}):
        assert found.timed(triplet, Settings().changed(changes)) is triplet
    found.begin(Start.COLD_GAP)
    assert found.is_found
    found.begin(Start.COLD_FRAME)
    assert found.is_found is None


@pytest.mark.parametrize(
    ("speed_m_s", "how"),
    [
        (15.0, {"is_corrected": True}),
        (15.0, {"is_reversed": True}),
        (1.0, {}),
    ],
    ids=["clouds of one moment", "the other order", "a slow sensor"],
)
def test_nothing_else_counts_as_turning(speed_m_s, how):
    assert not rotation(speed_m_s, **how).is_found


def test_times_go_once_around_with_the_middle_at_the_stamp():
    xyz = np.float32([[-1, 0.01, 0], [0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, -0.01, 0]])
    times_s = AzimuthTimes(True, 180.0).of(xyz, 0.1)
    np.testing.assert_allclose(times_s, [-0.05, -0.025, 0.0, 0.025, 0.05], atol=2e-4)
    np.testing.assert_allclose(AzimuthTimes(False, 180.0).of(xyz, 0.1), -times_s, atol=2e-4)


@pytest.mark.parametrize("num_beams", [1, 3])
def test_times_follow_points_that_go_around_once_or_once_for_each_beam(num_beams):
    angles = np.tile(np.linspace(3.0, -3.2, 500), num_beams)
    xyz = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1).astype(np.float32)
    times_s = times_in_order(xyz, 0.1)
    assert -0.05 == times_s[0] == times_s.min()
    np.testing.assert_allclose(times_s[-500:], np.linspace(-0.05, 0.0487, 500), atol=2e-4)


def test_points_in_no_order_have_no_times():
    rng = np.random.default_rng(0)
    assert times_in_order(np.zeros((0, 3), np.float32), 0.1) is None
    assert times_in_order(np.abs(rng.normal(size=(1000, 3))).astype(np.float32), 0.1) is None
