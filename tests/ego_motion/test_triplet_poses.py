# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses of sweeps that are in several triplets."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from box_street import INTERVAL_NS, pose

from mnsf_ros.ego_motion.ego_motion import EgoSource, TripletPoses
from mnsf_ros.errors import SweepError
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

SETTINGS = EgoMotionSettings(source="odometry", max_gap_s=0.5)


def path(index):
    """Half a metre a sweep in a curve."""
    return pose(0.5 * index, 0.1 * index, yaw_deg=2.0 * index)


def sweep_at(index, frame_id="lidar"):
    xyz = np.zeros((1, 3), np.float32)
    return Sweep(xyz, index * INTERVAL_NS, frame_id, odometry=path(index))


def check_motions(poses, sweeps):
    """Makes sure that the poses of the sweeps are in one world."""
    for before, sweep in pairwise(sweeps):
        found = np.linalg.inv(poses[before].world_from_sensor) @ poses[sweep].world_from_sensor
        expected = np.linalg.inv(before.odometry) @ sweep.odometry
        assert np.allclose(found, expected, atol=1e-9)


def test_sweep_has_the_same_pose_in_all_triplets():
    poses = TripletPoses(SETTINGS)
    sweeps = [sweep_at(index) for index in range(4)]
    first, second = poses.of(SweepTriplet(*sweeps[:3])), poses.of(SweepTriplet(*sweeps[1:]))
    assert all(first[sweep] is second[sweep] for sweep in sweeps[1:3])
    check_motions(first | second, sweeps)


def test_first_sweep_of_all_is_the_start():
    sweeps = [sweep_at(index) for index in range(4)]
    found = TripletPoses(SETTINGS).of(SweepTriplet(*sweeps[1:], earlier=(sweeps[0],)))
    assert [found[sweep].source for sweep in sweeps] == [EgoSource.START, *[EgoSource.ODOMETRY] * 3]
    check_motions(found, sweeps)


def test_triplet_with_an_older_sweep_before_known_ones_starts_anew():
    poses = TripletPoses(SETTINGS)
    sweeps = [sweep_at(index) for index in range(5)]
    for first in range(3, -1, -1):
        triplet = SweepTriplet(None, *sweeps[first : first + 2])
        check_motions(poses.of(triplet), sweeps[first : first + 2])
    triplet = SweepTriplet(*sweeps[:3])
    check_motions(poses.of(triplet), sweeps[:3])


def test_sweep_that_was_left_out_before_starts_anew():
    """The next triplet has one in the middle that is not known."""
    poses = TripletPoses(SETTINGS)
    sweeps = [sweep_at(index) for index in range(4)]
    poses.of(SweepTriplet(sweeps[0], sweeps[1], sweeps[3]))
    check_motions(poses.of(SweepTriplet(*sweeps[1:])), sweeps[1:])


@pytest.mark.parametrize("late", [sweep_at(0), sweep_at(2, frame_id="roof"), sweep_at(7)])
def test_error_says_which_sweeps_and_which_setting(late):
    """A sweep that is older, of another frame, or after too long a gap."""
    triplet = SweepTriplet(None, sweep_at(1), late)
    with pytest.raises(SweepError) as caught:
        TripletPoses(SETTINGS).of(triplet)
    text = str(caught.value)
    assert f"sweep {late.stamp_ns} ns of frame {late.frame_id!r} cannot follow" in text
    assert "sweep 100000000 ns of frame 'lidar'" in text
    assert "within 0.5 s (ego_motion.max_gap_s)" in text
