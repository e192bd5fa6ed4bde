# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps that are bent by the motion of the sensor while it turns."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import BoxStreet, angle_deg, distance_m, pose

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.settings import EgoMotionSettings, Settings

STREET = BoxStreet()
DESKEW = EgoMotionSettings()
AS_THEY_CAME = Settings().changed({"ego_motion.deskew": False}).ego_motion


def turning(index):
    """Round a bend of 6 m radius: 0.6 m and 6 degrees a sweep."""
    angle = np.radians(6 * index)
    return pose(6 * np.sin(angle), 6 - 6 * np.cos(angle), yaw_deg=6 * index)


def braking(index):
    """From 15 m/s with 3 m/s²."""
    return pose(1.5 * index - 0.015 * index**2)


def steady(index):
    return pose(1.5 * index, 0.1 * index, yaw_deg=index)


def swaying(index):
    """On legs: heaves, and nods with 5 degrees, 1.5 times a second."""
    phase = 0.3 * np.pi * index
    return pose(0.1 * index, z=0.05 * np.sin(phase), pitch_deg=5 * np.cos(phase))


def spinning(index):
    """On the spot, 10 degrees a sweep."""
    return pose(yaw_deg=10 * index)


def sweeps_of(path, number=6, **how):
    return [STREET.bent_sweep(path, index, **how)[0] for index in range(number)]


def poses_of(sweeps, settings=DESKEW):
    ego_motion = EgoMotion(settings)
    return [ego_motion.pose_of(sweep) for sweep in sweeps]


class TestPoses:
    @pytest.mark.parametrize("path", [steady, turning, braking, spinning])
    @pytest.mark.parametrize("first_s", [0.0, -0.05, -0.1], ids=["start", "middle", "end"])
    def test_are_those_of_the_stamps(self, path, first_s):
        found = poses_of(sweeps_of(path, first_s=first_s))
        step = np.linalg.inv(found[3].world_from_stamp) @ found[5].world_from_stamp
        true = np.linalg.inv(path(3)) @ path(5)
        assert distance_m(step, true) < 0.03
        assert angle_deg(step, true) < 0.15

    @pytest.mark.parametrize("path", [steady, turning, spinning])
    def test_points_are_put_together_again(self, path):
        settled = []
        for settings in (DESKEW, AS_THEY_CAME):
            ego_motion = EgoMotion(settings)
            for index in range(5):
                sweep, straight = STREET.bent_sweep(path, index)
                found = ego_motion.pose_of(sweep)
            stamp_from_moment = np.linalg.inv(found.world_from_stamp) @ found.world_from_sensor
            points = found.in_one_moment(sweep)
            there = points @ stamp_from_moment[:3, :3].T + stamp_from_moment[:3, 3]
            settled.append(np.abs(there - straight).max())
        deskewed_m, raw_m = settled
        assert deskewed_m < 0.06
        assert raw_m > 1.0

    def test_follow_a_sensor_that_sways_within_a_sweep(self):
        """The mean of the motions between sweeps is 0: with it the steps are off by 3 degrees."""
        sweeps = sweeps_of(swaying, 16)
        found = poses_of(sweeps)
        off_deg = []
        for index in range(8, 15):
            step = np.linalg.inv(found[index].world_from_stamp) @ found[index + 1].world_from_stamp
            off_deg.append(angle_deg(step, np.linalg.inv(swaying(index)) @ swaying(index + 1)))
        assert np.mean(off_deg) < 0.6

    def test_of_the_first_sweep_are_known_from_the_second_one(self):
        """The first sweep is in the map as it came; a bend of 20 degrees must not be believed."""
        first, second = sweeps_of(spinning, 2)
        deskewed = poses_of([first, second])[1]
        raw = poses_of([first, second], AS_THEY_CAME)[1]
        for found in (deskewed, raw):
            assert found.source is EgoSource.REGISTRATION
        step = np.linalg.inv(spinning(0)) @ spinning(1)
        assert angle_deg(deskewed.world_from_sensor, step) < 0.15

    def test_odometry_bends_too(self):
        sweeps = [
            replace(sweep, odometry=turning(index))
            for index, sweep in enumerate(sweeps_of(turning, 3))
        ]
        wanted = Settings().changed({"ego_motion.source": "odometry"}).ego_motion
        found = poses_of(sweeps, wanted)[2]
        assert found.source is EgoSource.ODOMETRY
        straight = STREET.bent_sweep(turning, 2)[1]
        stamp_from_moment = np.linalg.inv(found.world_from_stamp) @ found.world_from_sensor
        there = found.in_one_moment(sweeps[2]) @ stamp_from_moment[:3, :3].T
        np.testing.assert_allclose(there + stamp_from_moment[:3, 3], straight, atol=0.02)


def test_without_times_or_deskewing_nothing_changes():
    sweeps = sweeps_of(turning)
    without = [replace(sweep, times_s=None) for sweep in sweeps]
    expected = poses_of(without)
    for other in (poses_of(without, AS_THEY_CAME), poses_of(sweeps, AS_THEY_CAME)):
        for one, two in zip(expected, other, strict=True):
            np.testing.assert_array_equal(one.world_from_sensor, two.world_from_sensor)
            np.testing.assert_array_equal(one.world_from_stamp, two.world_from_stamp)


class TestOddTimes:
    def test_some_sweeps_have_none(self):
        """At 15 m/s such a sweep is bent by 1.5 m, and does not match one that is not."""
        sweeps = sweeps_of(steady, 8)
        for index in (0, 3, 4):
            sweeps[index] = replace(sweeps[index], times_s=None)
        found = poses_of(sweeps)
        assert all(item.source is EgoSource.REGISTRATION for item in found[6:])
        for index in range(1, 8):
            step = (
                np.linalg.inv(found[index - 1].world_from_sensor) @ found[index].world_from_sensor
            )
            error_m = distance_m(step, np.linalg.inv(steady(index - 1)) @ steady(index))
            assert error_m < (0.05 if index > 5 else 0.3) or found[index].lost

    def test_equal_stamps_leave_points_where_they_are(self):
        sweeps = [replace(sweep, stamp_ns=5) for sweep in sweeps_of(steady, 3)]
        for sweep, found in zip(sweeps, poses_of(sweeps), strict=True):
            assert found.in_one_moment(sweep) is sweep.xyz
