# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Ego motion with the turn rates of an IMU."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import INTERVAL_NS, BoxStreet, angle_deg, pose
from scipy.spatial.transform import Rotation

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.settings import EgoMotionSettings

STREET = BoxStreet()
INTERVAL_S = INTERVAL_NS / 1e9
BIAS = np.radians([3.0, -8.0, 15.0])
NUM_SWEEPS = 24
SETTLED = 14  # so many sweeps until rates are trusted


def shaken(index):
    """On foot: the lidar looks left and right with 2 Hz, and nods."""
    phase = 2 * np.pi * 2 * index * INTERVAL_S
    return pose(0.1 * index, yaw_deg=12 * np.sin(phase), pitch_deg=2 * np.sin(1.3 * phase))


def rates_of(path, index, every_s=0.005, start_s=-1.0, end_s=0.11):
    """Turn rates around a sweep, with a bias."""
    times_s = np.arange(start_s, end_s, every_s)
    step = 1e-3

    def turn(time_s):
        first, second = (path(index + time_s / INTERVAL_S + off) for off in (-step, step))
        return Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()

    rates = np.array([turn(time_s) for time_s in times_s]) / (2 * step * INTERVAL_S)
    return np.column_stack([times_s, rates + BIAS])


def swayed(index):
    """As slowly as registration alone can follow."""
    phase = 2 * np.pi * index * INTERVAL_S
    return pose(0.1 * index, yaw_deg=6 * np.sin(phase), pitch_deg=2 * np.sin(1.3 * phase))


def sweeps_of(path):
    found = [STREET.bent_sweep(path, index)[0] for index in range(NUM_SWEEPS)]
    return [replace(sweep, turn_rates=rates_of(path, index)) for index, sweep in enumerate(found)]


@pytest.fixture(scope="module")
def sweeps():
    return sweeps_of(shaken)


@pytest.fixture(scope="module")
def swayed_sweeps():
    return sweeps_of(swayed)


def poses_of(sweeps, **settings):
    ego_motion = EgoMotion(replace(EgoMotionSettings(), **settings))
    return [ego_motion.pose_of(sweep) for sweep in sweeps]


def errors_deg(found, first=SETTLED, path=shaken):
    """Of the rotation from sweep to sweep."""
    return [
        angle_deg(
            np.linalg.inv(found[index].world_from_stamp) @ found[index + 1].world_from_stamp,
            np.linalg.inv(path(index)) @ path(index + 1),
        )
        for index in range(first, len(found) - 1)
    ]


def without_imu(sweeps):
    return [replace(sweep, turn_rates=None) for sweep in sweeps]


def test_rotations_and_deskewing_get_better(sweeps):
    with_imu, without = poses_of(sweeps), poses_of(without_imu(sweeps))
    assert max(errors_deg(with_imu)) < 0.35
    assert np.mean(errors_deg(without)) > 3 * np.mean(errors_deg(with_imu))
    bent = []
    for found in (with_imu, without):
        sweep, straight = sweeps[-1], STREET.bent_sweep(shaken, NUM_SWEEPS - 1)[1]
        stamp_from_moment = np.linalg.inv(found[-1].world_from_stamp) @ found[-1].world_from_sensor
        there = found[-1].in_one_moment(sweep) @ stamp_from_moment[:3, :3].T
        bent.append(np.abs(there + stamp_from_moment[:3, 3] - straight).mean())
    assert bent[0] < 0.035
    assert bent[1] > 3 * bent[0]


def test_vectors_turn_back_to_the_axes_of_their_time(sweeps):
    motion = poses_of(sweeps)[-1].motion
    times_s = np.array([0.0, 0.05, 0.0999], np.float32)
    vectors = np.tile(np.float32([10, 0, 0]), (3, 1))
    back = motion.turned_back(vectors, times_s)
    turns = [shaken(NUM_SWEEPS - 1 + time_s / INTERVAL_S)[:3, :3] for time_s in (*times_s, 0.05)]
    expected = [turn.T @ turns[-1] @ [10, 0, 0] for turn in turns[:3]]
    np.testing.assert_allclose(back, expected, atol=0.05)


def degrees(rates):
    return np.column_stack([rates[:, 0], np.degrees(rates[:, 1:])])


def other_axes(rates):
    return rates[:, [0, 3, 1, 2]]


def with_gaps(rates):
    return rates[::15]


def of_another_clock(rates):
    return rates - [3600.0, 0, 0, 0]


def no_rates(_rates):
    return None


@pytest.mark.parametrize("spoil", [degrees, other_axes, with_gaps, of_another_clock])
def test_wrong_rates_do_little_harm(swayed_sweeps, spoil):
    spoiled = [replace(sweep, turn_rates=spoil(sweep.turn_rates)) for sweep in swayed_sweeps]
    found, expected = poses_of(spoiled), poses_of(without_imu(swayed_sweeps))
    assert all(each.source is EgoSource.REGISTRATION for each in found[SETTLED:])
    own, others = (np.mean(errors_deg(each, path=swayed)) for each in (found, expected))
    assert own < 1.1 * others


@pytest.mark.parametrize("spoil", [degrees, other_axes, no_rates])
def test_without_rates_a_hard_shake_is_said(sweeps, spoil):
    """Within a sweep the rate changes its sign: no steady motion puts the points together."""
    spoiled = [replace(sweep, turn_rates=spoil(sweep.turn_rates)) for sweep in sweeps]
    found = poses_of(spoiled)
    are_wrong = np.array(errors_deg(found, first=0)) > 5
    are_said = np.array([bool(each.lost) for each in found[1:]])
    assert are_wrong.sum() > 10
    assert (are_wrong & ~are_said).sum() < 4


@pytest.mark.parametrize("rates", [None, np.empty((0, 4)), np.zeros((1, 4))])
def test_without_usable_rates_nothing_changes(sweeps, rates):
    expected = poses_of(sweeps[:6], imu=False)
    found = poses_of([replace(sweep, turn_rates=rates) for sweep in sweeps[:6]])
    for one, two in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one.world_from_sensor, two.world_from_sensor)


def test_a_lost_sweep_turns_on(sweeps):
    """Nothing but rates tells the rotation while the lidar is covered."""
    covered = [*sweeps[:-1], sweeps[-1].part(np.arange(20))]
    found = poses_of(covered)
    assert found[-1].source is EgoSource.LOST
    assert errors_deg(found)[-1] < 0.3
