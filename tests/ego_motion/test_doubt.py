# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""An ego motion that doubts itself; benchmarks/lost.py disturbs it in more ways."""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from box_street import angle_deg, distance_m

from mnsf_ros.ego_motion import pieces
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep

SETTINGS = EgoMotionSettings()
SMALL = {"num_beams": 32, "num_columns": 600}
NO_MOTION = np.eye(4)


class Seen(NamedTuple):
    sweep: Sweep
    pose: np.ndarray


class Step(NamedTuple):
    """Of the pose since the last sweep: its error, and what is said."""

    error_m: float
    error_deg: float
    lost: str


def seen(numbers, **settings):
    """Sweeps of a simulation, by their numbers."""
    simulator = SweepSimulator(SimulationSettings(duration_s=30.0, **settings))
    for number in numbers:
        one = simulator.sweep(number)
        times_ns = one.columns.get("t")
        times_s = None if times_ns is None else (times_ns / 1e9).astype(np.float32)
        yield Seen(Sweep(one.xyz, one.truth.stamp_ns, times_s=times_s), one.pose)


def steps(drive):
    ego_motion, drive = EgoMotion(SETTINGS), list(drive)
    found = [ego_motion.pose_of(each.sweep) for each in drive]
    for (before, after), (was, is_) in zip(pairwise(found), pairwise(drive), strict=True):
        step = np.linalg.inv(before.world_from_stamp) @ after.world_from_stamp
        true = np.linalg.inv(was.pose) @ is_.pose
        yield Step(distance_m(step, true), angle_deg(step, true), after.lost)


@pytest.fixture(scope="module")
def street():
    """At 8 m/s."""
    return list(seen(range(50), seed=0, **SMALL))


@pytest.mark.parametrize("gap", [3, 6, 10, 15, 30])
def test_after_a_gap_poses_are_right_or_said_to_be_lost(street, gap):
    order = [*range(8), *range(7 + gap, min(7 + gap + 10, 50))]
    found = list(steps(street[number] for number in order))
    at_gap, after = found[7], found[8:]
    assert at_gap.error_m < 0.1 or at_gap.lost
    assert all(step.error_m < 0.03 or step.lost for step in after)
    assert not any(step.lost for step in after[1:])


class TestAStuckDriver:
    @pytest.mark.parametrize("period", [1, 3], ids=["one cloud", "three clouds in turn"])
    def test_is_said_and_what_follows_is_right(self, street, period):
        stuck = [
            Seen(replace(street[10 - number % period].sweep, stamp_ns=now.sweep.stamp_ns), now.pose)
            for number, now in enumerate(street[11:25])
        ]
        found = list(steps([*street[:11], *stuck, *street[25:30]]))
        said = ["clouds repeat" in step.lost for step in found]
        # The first cloud after it follows one that is older than its stamp.
        assert said == 10 * [False] + 15 * [True] + 4 * [False]
        assert max(step.error_m for step in found[-4:]) < 0.03

    def test_equal_clouds_of_one_time_are_none(self, street):
        again = [street[3], Seen(replace(street[3].sweep), street[3].pose)]
        assert not any(step.lost for step in steps([*street[:3], *again, *street[4:6]]))

    def test_few_points_that_differ_are_enough(self, street):
        """Someone walks before a robot that stands in a simulation without noise."""
        ego_motion = EgoMotion(SETTINGS)
        for number in range(3):
            xyz = street[0].sweep.xyz.copy()
            xyz[100:130] += np.float32(0.1 * number)
            found = ego_motion.pose_of(Sweep(xyz, 10**8 * number))
        assert found.source is EgoSource.REGISTRATION


class TestTestimony:
    def of(self, motion, first, second, step_rad=0.0105):
        clouds = (Cloud.of(each.sweep, None, SETTINGS) for each in (first, second))
        other, cloud = clouds
        return pieces.Testimony.of(pieces.Pieces.of(cloud, step_rad), motion, other)

    def test_tells_the_right_motion_from_a_wrong_one(self, street):
        true = np.linalg.inv(street[4].pose) @ street[5].pose
        right, wrong = (self.of(each, *street[4:6]) for each in (true, NO_MOTION))
        assert right.share < 0.1
        assert wrong.share > 0.2
        assert wrong.contradicts_more(right, 3.0)
        assert not right.contradicts_more(wrong, 0.0)

    def test_traces_of_beams_on_ground_and_ceiling_are_no_pieces(self):
        """They travel along with the sensor: each has one height."""
        angles = np.linspace(0, 2 * np.pi, 900)
        rings = [
            (r * np.cos(angles), r * np.sin(angles), z + 0 * angles)
            for r, z in ((5, -1.5), (9, -1.5), (6, 2.0), (10, 2.0))
        ]
        xyz = np.concatenate([np.stack(ring, axis=1) for ring in rings]).astype(np.float32)
        assert len(pieces.Pieces.of(Cloud.of(Sweep(xyz), None, SETTINGS), 0.0)) == 0

    def test_of_few_pieces_says_nothing(self, street):
        post = Sweep(
            np.random.default_rng(0).uniform(3, 3.4, (200, 3)).astype(np.float32) - [0, 0, 2]
        )
        lonely = Seen(replace(post, xyz=post.xyz.astype(np.float32)), NO_MOTION)
        found = self.of(NO_MOTION, street[0], lonely)
        assert (found.num_against, found.share) == (0, 0.0)

    def test_sparse_columns_are_no_contradiction(self):
        """Of two sweeps of a lidar that stands, other points of the same walls are seen."""
        sparse = list(seen(range(2), num_beams=32, num_columns=256, ego_speed_m_s=0.0))
        step_rad = 2 * np.pi / 256
        known, unknown = (self.of(NO_MOTION, *sparse, each) for each in (step_rad, 0.0))
        assert unknown.share > 0.2
        assert known.share < 0.8 * unknown.share
