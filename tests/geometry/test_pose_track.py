# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses of the robot by odometry, and the sensor's pose at the stamps of sweeps."""

import numpy as np
import pytest
from box_street import distance_m, pose

from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.geometry.transforms import sensor_mount
from mnsf_ros.settings import EgoMotionSettings

MS = 1_000_000
START_NS = 50_000 * MS


def path(time_ms):
    """1 m/s along x, and 30 degrees a second to the left."""
    return pose(time_ms / 1000, yaw_deg=0.03 * time_ms)


def stamped(time_ms, matrix=None):
    matrix = path(time_ms) if matrix is None else matrix
    return StampedPose(START_NS + round(time_ms * MS), matrix, "base")


def track_of(*times_ms):
    """As live: poses are added."""
    track = PoseTrack()
    for time_ms in times_ms:
        assert track.add(stamped(time_ms))
    return track


def recorded(*times_ms):
    """As offline: poses are read on the way, None where some are missing."""
    return PoseTrack(None if time_ms is None else stamped(time_ms) for time_ms in times_ms)


def pose_at(track, time_ms):
    found = track.pose_at(START_NS + round(time_ms * MS))
    return None if found is None else found.world_from_frame


@pytest.mark.parametrize("time_ms", [0, 1, 50, 100, 130, 200])
def test_pose_is_interpolated(time_ms):
    track = track_of(0, 100, 200)
    np.testing.assert_allclose(pose_at(track, time_ms), path(time_ms), atol=1e-9)


def test_a_gap_is_not_bridged():
    track = track_of(0, 300, 601)
    assert pose_at(track, 150) is not None
    assert pose_at(track, 450) is None
    # At a pose itself there is nothing to bridge.
    np.testing.assert_array_equal(pose_at(track, 601), path(601))


def test_the_motion_goes_on_for_a_tenth_of_a_second():
    track = track_of(0, 100)
    np.testing.assert_allclose(pose_at(track, 170), path(170), atol=1e-9)
    assert pose_at(track, 200) is not None
    assert pose_at(track, 200.001) is None


def test_the_noise_of_close_poses_does_not_grow():
    """At 500 Hz a millimetre between neighbors would be 50 after a tenth of a second."""
    track = PoseTrack()
    for number, time_ms in enumerate(range(0, 102, 2)):
        noise = pose(y=0.001 * (-1) ** number)
        track.add(stamped(time_ms, path(time_ms) @ noise))
    assert distance_m(pose_at(track, 190), path(190)) < 0.01


def test_one_pose_holds_at_its_own_stamp_only():
    track = track_of(0)
    np.testing.assert_array_equal(pose_at(track, 0), path(0))
    assert pose_at(track, 1) is None
    assert pose_at(track, -1) is None
    assert PoseTrack().pose_at(0) is None


@pytest.mark.parametrize("time_ms", [200, 150, -700])
def test_a_pose_that_is_not_newer_is_left_out(time_ms):
    track = track_of(0, 100, 200)
    assert track.add(stamped(time_ms, pose(99))) is False
    np.testing.assert_allclose(pose_at(track, 150), path(150), atol=1e-9)


def test_a_clock_that_jumps_back_forgets_what_was_before():
    track = track_of(5000, 5100)
    assert track.add(stamped(0)) is True
    assert track.add(stamped(100)) is True
    assert pose_at(track, 5050) is None
    np.testing.assert_allclose(pose_at(track, 50), path(50), atol=1e-9)


def test_only_so_many_poses_are_kept():
    track = track_of(*range(0, 30_000, 10))
    assert pose_at(track, 5) is None
    np.testing.assert_allclose(pose_at(track, 29_985), path(29_985), atol=1e-9)


TIMES_MS = (0, 90, 200, 500, 801, 900, 1850, 1950)


@pytest.mark.parametrize("time_ms", [-1, 0, 40, 350, 650, 850, 960, 2040])
def test_recorded_and_live_poses_give_the_same(time_ms):
    """But for what is live not known yet, where a pose after the stamp is still to come."""
    live, offline = track_of(*TIMES_MS), recorded(*TIMES_MS)
    np.testing.assert_equal(pose_at(offline, time_ms), pose_at(live, time_ms))


def test_nothing_is_read_beyond_need():
    poses = (stamped(time_ms) for time_ms in range(0, 10_000, 100))
    track = PoseTrack(poses)
    np.testing.assert_allclose(pose_at(track, 250), path(250), atol=1e-9)
    assert next(poses).stamp_ns == START_NS + 400 * MS


def test_no_pose_where_damage_took_some():
    track = recorded(0, 100, None, 300, 400)
    np.testing.assert_allclose(pose_at(track, 50), path(50), atol=1e-9)
    assert pose_at(track, 200) is None
    np.testing.assert_array_equal(pose_at(track, 300), path(300))
    np.testing.assert_allclose(pose_at(track, 350), path(350), atol=1e-9)


def test_one_sweep_with_a_wrong_stamp_does_not_cost_the_others_their_poses():
    track = recorded(*range(1_000_000, 1_020_000, 100))
    for time_ms in (1_001_000, 5000, 1_000_900, 1_010_000):
        expected = None if time_ms == 5000 else path(time_ms)
        np.testing.assert_equal(pose_at(track, time_ms), expected)


def test_place_of_the_sensor_is_added_in_the_frame_of_the_robot():
    settings = EgoMotionSettings(sensor_x_m=2.0, sensor_z_m=1.5)
    track = PoseTrack(mount=sensor_mount(settings))
    track.add(StampedPose(0, pose(10, 20, yaw_deg=90), "base"))
    # The robot looks along y: 2 m ahead of it is 2 m along y.
    found = track.pose_at(0)
    np.testing.assert_allclose(found.world_from_frame, pose(10, 22, 1.5, yaw_deg=90), atol=1e-12)
    assert found.frame_id == ""
    # Between two poses the sensor is on the arc of its lever, not on the chord.
    track.add(StampedPose(100 * MS, pose(10, 20, yaw_deg=150), "base"))
    position = track.pose_at(50 * MS).world_from_frame[:3, 3]
    np.testing.assert_allclose(np.linalg.norm(position - (10, 20, 1.5)), 2.0, atol=1e-9)
