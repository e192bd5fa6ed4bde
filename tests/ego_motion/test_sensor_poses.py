# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses of sweeps that are in several triplets."""

from itertools import pairwise

import numpy as np
from box_street import INTERVAL_NS, pose

from mnsf_ros.ego_motion.ego_motion import EgoSource, SensorPoses
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

SETTINGS = EgoMotionSettings(source="odometry")


def sweep_at(index):
    """Half a metre a sweep in a curve."""
    path = pose(0.5 * index, 0.1 * index, yaw_deg=2.0 * index)
    return Sweep(np.full((1, 3), index, np.float32), index * INTERVAL_NS, "lidar", odometry=path)


def check_motions(poses, sweeps):
    """Makes sure that the poses of the sweeps are in one world."""
    for before, sweep in pairwise(sweeps):
        found = np.linalg.inv(poses[before].world_from_sensor) @ poses[sweep].world_from_sensor
        expected = np.linalg.inv(before.odometry) @ sweep.odometry
        assert np.allclose(found, expected, atol=1e-9)


def test_sweep_has_the_same_pose_in_all_triplets():
    poses = SensorPoses(SETTINGS)
    sweeps = [sweep_at(index) for index in range(40)]
    known = {}
    for first in range(len(sweeps) - 2):
        found = poses.of(sweeps[first : first + 3])
        assert all(known.get(sweep, found[sweep]) is found[sweep] for sweep in found)
        known |= found
    check_motions(known, sweeps)
    assert known[sweeps[0]].source is EgoSource.START
    assert {known[sweep].source for sweep in sweeps[1:]} == {EgoSource.ODOMETRY}
    assert len(poses._poses) <= 12
