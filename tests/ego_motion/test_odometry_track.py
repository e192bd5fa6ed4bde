"""Poses of the robot by odometry, and the sensor's pose at the stamps of sweeps."""

from __future__ import annotations

import numpy as np
import pytest
from box_street import angle_deg, distance_m, pose

from mnsf_ros.ego_motion.odometry_track import OdometryTrack
from mnsf_ros.ego_motion.pose_interpolation import interpolated_pose
from mnsf_ros.settings import EgoMotionSettings, Settings

MS = 1_000_000
START_NS = 50_000 * MS


def path(time_ms):
    """1 m/s along x, and 30 degrees a second to the left."""
    return pose(time_ms / 1000, yaw_deg=0.03 * time_ms)


def track_of(*times_ms, **settings):
    names = {f"ego_motion.{name}": value for name, value in settings.items()}
    track = OdometryTrack(Settings().changed(names).ego_motion)
    for time_ms in times_ms:
        assert track.add(START_NS + time_ms * MS, path(time_ms))
    return track


def pose_at(track, time_ms):
    return track.sensor_pose_at(START_NS + round(time_ms * MS))


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


class TestBetweenPoses:
    @pytest.mark.parametrize("time_ms", [0, 1, 50, 100, 130, 200])
    def test_pose_is_interpolated(self, time_ms):
        track = track_of(0, 100, 200)
        np.testing.assert_allclose(pose_at(track, time_ms), path(time_ms), atol=1e-9)

    def test_a_gap_is_not_bridged(self):
        track = track_of(0, 300, 601)
        assert pose_at(track, 150) is not None
        assert pose_at(track, 450) is None
        # At a pose itself there is nothing to bridge.
        np.testing.assert_array_equal(pose_at(track, 601), path(601))


class TestBesideThePoses:
    def test_the_motion_goes_on_for_a_tenth_of_a_second(self):
        track = track_of(0, 100)
        np.testing.assert_allclose(pose_at(track, 170), path(170), atol=1e-9)
        assert pose_at(track, 200) is not None
        assert pose_at(track, 200.001) is None

    def test_the_noise_of_close_poses_does_not_grow(self):
        """At 500 Hz a millimetre between neighbors would be 50 after a tenth of a second."""
        track = OdometryTrack(EgoMotionSettings())
        for number, time_ms in enumerate(range(0, 102, 2)):
            noise = pose(y=0.001 * (-1) ** number)
            track.add(START_NS + time_ms * MS, path(time_ms) @ noise)
        assert distance_m(pose_at(track, 190), path(190)) < 0.01

    def test_close_poses_after_a_gap_go_on_by_themselves(self):
        track = track_of(0, 1000, 1010)
        np.testing.assert_allclose(pose_at(track, 1030), path(1030), atol=1e-9)

    def test_nothing_goes_on_after_a_gap(self):
        assert pose_at(track_of(0, 301), 310) is None

    def test_before_the_first_pose_nothing_is_known(self):
        assert pose_at(track_of(0, 100), -1) is None

    def test_one_pose_holds_at_its_own_stamp_only(self):
        track = track_of(0)
        np.testing.assert_array_equal(pose_at(track, 0), path(0))
        assert pose_at(track, 1) is None

    def test_without_poses_nothing_is_known(self):
        assert OdometryTrack(EgoMotionSettings()).sensor_pose_at(0) is None


class TestOrder:
    @pytest.mark.parametrize("time_ms", [200, 150, -700])
    def test_a_pose_that_is_not_newer_is_left_out(self, time_ms):
        track = track_of(0, 100, 200)
        assert track.add(START_NS + time_ms * MS, pose(99)) is False
        np.testing.assert_allclose(pose_at(track, 150), path(150), atol=1e-9)

    def test_a_clock_that_jumps_back_forgets_what_was_before(self):
        track = track_of(5000, 5100)
        assert track.add(START_NS, path(0)) is True
        assert track.add(START_NS + 100 * MS, path(100)) is True
        assert pose_at(track, 5050) is None
        np.testing.assert_allclose(pose_at(track, 50), path(50), atol=1e-9)

    def test_a_clock_that_jumps_ahead_leaves_a_gap(self):
        track = track_of(0, 100, 9000, 9100)
        assert pose_at(track, 4000) is None
        np.testing.assert_allclose(pose_at(track, 9050), path(9050), atol=1e-9)

    def test_only_so_many_poses_are_kept(self):
        track = track_of(*range(0, 30_000, 10))
        assert pose_at(track, 5) is None
        np.testing.assert_allclose(pose_at(track, 29_985), path(29_985), atol=1e-9)


class TestExtrinsics:
    def test_place_of_the_sensor_is_added_in_the_frame_of_the_robot(self):
        track = OdometryTrack(EgoMotionSettings(sensor_x_m=2.0, sensor_z_m=1.5))
        track.add(0, pose(10, 20, yaw_deg=90))
        # The robot looks along y: 2 m ahead of it is 2 m along y.
        np.testing.assert_allclose(
            track.sensor_pose_at(0), pose(10, 22, 1.5, yaw_deg=90), atol=1e-12
        )

    def test_angles_are_yaw_then_pitch_then_roll(self):
        track = OdometryTrack(EgoMotionSettings(sensor_yaw_deg=90, sensor_pitch_deg=90))
        track.add(0, np.eye(4))
        # Pitched by 90 degrees the sensor's x points down; its z is the old x, yawed to the left.
        sensor = track.sensor_pose_at(0)
        np.testing.assert_allclose(sensor[:3, 0], (0, 0, -1), atol=1e-12)
        np.testing.assert_allclose(sensor[:3, 2], (0, 1, 0), atol=1e-12)

    def test_roll_turns_about_the_axis_ahead(self):
        track = OdometryTrack(EgoMotionSettings(sensor_roll_deg=90))
        track.add(0, np.eye(4))
        np.testing.assert_allclose(track.sensor_pose_at(0)[:3, 1], (0, 0, 1), atol=1e-12)

    def test_a_lever_makes_a_turn_of_the_robot_a_motion_of_the_sensor(self):
        track = OdometryTrack(EgoMotionSettings(sensor_x_m=1.0))
        track.add(START_NS, pose())
        track.add(START_NS + 100 * MS, pose(yaw_deg=60))
        first, middle, last = (pose_at(track, time_ms) for time_ms in (0, 50, 100))
        assert distance_m(first, last) == pytest.approx(1.0)
        assert angle_deg(first, middle) == pytest.approx(30)
        # On the arc, not on the chord.
        assert np.linalg.norm(middle[:3, 3]) == pytest.approx(1.0)
