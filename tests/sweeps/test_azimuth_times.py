# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of points against the direction in which a turning lidar looks."""

import numpy as np
import pytest

from mnsf_ros.sweeps.azimuth_times import Turn, contradicted

NUM = 20_000
RANDOM = np.random.default_rng(0)


def turning(sense=-1, share=1.0, start=0.3):
    """Points of a lidar that turns through a share of a turn in 0.1 s, and their times."""
    shares = np.sort(RANDOM.uniform(0, 1, NUM))
    angles = 2 * np.pi * (start + sense * share * shares)
    ranges, heights = RANDOM.uniform(3, 60, NUM), RANDOM.uniform(-2, 5, NUM)
    xyz = np.stack([ranges * np.cos(angles), ranges * np.sin(angles), heights], axis=1)
    return xyz.astype(np.float32), (0.1 * shares).astype(np.float32)


@pytest.mark.parametrize("sense", [-1, 1])
@pytest.mark.parametrize("share", [1.0, 0.75, 0.1])
def test_a_turn_is_found_by_azimuths_and_times(sense, share):
    xyz, times_s = turning(sense, share)
    turn = Turn.of(np.arctan2(xyz[:, 1], xyz[:, 0]) / (2 * np.pi), times_s)
    assert turn.sense == sense
    assert turn.duration_s == pytest.approx(0.1 / share, rel=0.01)
    assert not contradicted(xyz, times_s, is_likely=True).any()
    assert str(Turn(0.1, sense, 0.3).by_azimuth(0.05)).endswith(":108")


def test_times_of_lost_packets_are_contradicted():
    xyz, times_s = turning()
    lost = np.zeros(NUM, bool)
    lost[RANDOM.permutation(NUM)[:400]] = True
    wrong = np.where(lost, np.float32(0), times_s)
    wrong[7] = np.nan
    found = contradicted(xyz, wrong, is_likely=False)
    assert found[7]
    assert not found[~lost][np.isfinite(wrong[~lost])].any()
    # Those that were measured at the beginning have nearly the right time.
    assert found[lost & (times_s > 0.02) & (times_s < 0.08)].all()


def test_an_origin_away_from_the_lens_contradicts_no_time():
    xyz, times_s = turning()
    assert not contradicted(xyz + np.float32([2.0, 0.5, 1.0]), times_s, is_likely=True).any()


@pytest.mark.parametrize("times_s", [RANDOM.uniform(0, 0.1, NUM), np.zeros(NUM)])
@pytest.mark.parametrize("share", [1.0, 0.1])
def test_a_lidar_that_does_not_turn_has_no_contradicted_time(times_s, share):
    xyz, _ = turning(share=share)
    assert not contradicted(xyz, times_s.astype(np.float32), is_likely=True).any()
    assert not contradicted(xyz[:0], times_s[:0].astype(np.float32), is_likely=True).any()
