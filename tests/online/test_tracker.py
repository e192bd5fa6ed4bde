# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracks: identity, prediction and correction, from sweep to sweep."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from small_scenes import moved_by, rows, surface, table_of

from mnsf_ros.core.reason import Verdict
from mnsf_ros.online.gate import mover_groups
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.tracker import Measurements, Tracker
from mnsf_ros.online.turning import rigid_motions
from mnsf_ros.settings import Settings

INTERVAL_S = 0.1


def objects_at(*centers, size=(2.0, 1.5, 1.5)):
    """One box at each place."""
    points = [surface(center, size, 48) for center in centers]
    number = len(centers)
    owners = np.repeat(np.arange(number), 48)
    xyz = np.concatenate([np.zeros((0, 3), np.float32), *points])
    return ObjectPoints(np.arange(number) + 1, xyz, owners, np.zeros(len(xyz), np.float32))


def seen(
    *centers, velocity=(10.0, 0.0, 0.0), turn_rate=0.0, size=(2.0, 1.5, 1.5), residual_rise_m=1.0
):
    """Boxes at these places, all with one velocity and turn rate, or each with its own."""
    number = len(centers)
    motions = np.float32(INTERVAL_S) * np.broadcast_to(np.float32(velocity), (number, 3))
    objects = objects_at(*centers, size=size)
    groups = mover_groups(objects, motions, objects.positions, objects.owners)
    table = table_of(
        objects,
        fitted=moved_by(motions),
        verdicts=Verdict.DYNAMIC,
        log_odds=3.0,
        residual_rise=residual_rise_m,
        groups=groups,
        linear_motions=rigid_motions(motions, np.full(number, turn_rate * INTERVAL_S)),
    )
    return Measurements.of(table, np.eye(4), INTERVAL_S)


class Follower:
    """Follows what it is shown, ten sweeps a second."""

    def __init__(self):
        self.tracker, self.tracks, self.now_ns = Tracker(Settings().warm_start, count(1)), [], 0

    def see(self, *centers, **how):
        """The numbers of the tracks of the boxes at these places, one sweep later."""
        return self.take(seen(*centers, **how))

    def take(self, measured):
        """The numbers of the tracks of measurements, one sweep later."""
        self.now_ns += round(INTERVAL_S * 1e9)
        predicted = self.tracker.predicted(self.now_ns, INTERVAL_S)
        self.tracks, ids = self.tracker.update(predicted, measured, self.now_ns, INTERVAL_S)
        return ids.tolist()


class TestIdentity:
    def test_goes_on_with_the_motion(self):
        follower = Follower()
        for index in range(10):
            assert follower.see((index, 0, 0), (index, 10, 0)) == [1, 2]

    @pytest.mark.parametrize(("num_hidden", "same"), [(1, True), (4, True), (5, False)])
    def test_outlasts_half_a_second_unseen(self, num_hidden, same):
        follower = Follower()
        follower.see((0, 0, 0))
        for _ in range(num_hidden):
            assert follower.see() == []
        assert follower.see((1 + num_hidden, 0, 0)) == ([1] if same else [2])

    def test_remembers_how_it_turns(self):
        follower = Follower()
        for index, turn_rate in enumerate((0.4, 0.4, 0.4, 0.0)):
            follower.see((index, 0, 0), (index, 10, 0), turn_rate=turn_rate)
            rates = [track.turn_rate for track in follower.tracks]
            assert rates == pytest.approx(2 * [(0.2, 0.3, 0.35, 0.175)[index]])

    def test_goes_on_with_the_largest_part(self):
        follower = Follower()
        follower.see((0, 0, 0), velocity=(0, 0, 0))
        points = surface((0, 0, 0), (2.0, 1.5, 1.5), 48).astype(np.float64)
        is_end = points[:, 0].argsort().argsort() < 8
        parts = seen((0, 0, 0), (0, 0, 5), velocity=(0, 0, 0))
        points = np.concatenate([points[is_end], points[~is_end]])
        points[-8:, 0] += 2  # a side of it comes into view
        parts = replace(parts, points=points, owners=np.sort(~is_end).astype(np.int64))
        assert follower.take(parts) == [2, 1]

    def test_of_two_that_meet_stays_with_each(self):
        follower = Follower()
        for index in range(8):
            velocities = [(10, 0, 0), (-10, 0, 0)]
            ids = follower.see((index, 0, 0), (7.5 - index, 1.8, 0), velocity=velocities)
            assert ids == [1, 2]

    def test_what_grows_together_has_that_which_was_seen_more_often(self):
        follower = Follower()
        for index in range(6):
            follower.see((index, 0, 0))
        follower.see((6, 0, 0), (6, 3, 0))
        assert follower.see((7, 0, 0), size=(2.0, 7.0, 1.5)) == [1]
        assert [track.track_id for track in follower.tracks] == [1]


class TestState:
    def test_noise_is_smoothed_and_the_covariance_says_so(self):
        rng, follower, errors = np.random.default_rng(0), Follower(), []
        for index in range(40):
            velocity = rng.normal((10, 0, 0), 0.3)
            follower.see((index, 0, 0), velocity=velocity)
            errors.append(np.linalg.norm(follower.tracks[0].velocity - (10, 0, 0)))
        assert np.mean(errors[10:]) < 0.7 * 0.3 * np.sqrt(3)
        sigma = np.sqrt(follower.tracks[0].covariance[1, 1])
        assert 0.05 < sigma < 0.4

    @pytest.mark.parametrize(("residual_rise_m", "expected_m_s"), [(1.0, 11.2), (0.0, 10.0)])
    def test_a_motion_that_nothing_holds_says_little_of_the_velocity(
        self, residual_rise_m, expected_m_s
    ):
        follower = Follower()
        for index in range(6):
            follower.see((index, 0, 0))
        follower.see((6, 0, 0), velocity=(12, 0, 0), residual_rise_m=residual_rise_m)
        assert follower.tracks[0].velocity[0] == pytest.approx(expected_m_s, abs=0.1)

    def test_braking_is_followed_without_visible_lag(self):
        follower, speed, x = Follower(), 10.0, 0.0
        for _ in range(20):
            follower.see((x, 0, 0), velocity=(speed, 0, 0))
            x, speed = x + speed * INTERVAL_S, max(0.0, speed - 0.4)
        speed += 0.4
        assert follower.tracks[0].velocity[0] == pytest.approx(speed, abs=0.3)

    def test_is_less_sure_the_longer_it_is_unseen(self):
        follower = Follower()
        follower.see((0, 0, 0))
        sure = follower.tracks[0].covariance
        follower.see()
        assert (np.diagonal(follower.tracks[0].covariance) > np.diagonal(sure)).all()


@pytest.mark.parametrize(
    ("away_m", "second_motion", "groups"),
    [
        (2.3, (1, 0.1, 0), [0, 0]),
        (3.5, (1, 0, 0), [0, 1]),
        (2.3, (0.5, 0, 0), [0, 1]),
    ],
    ids=["close and alike", "far apart", "different motions"],
)
def test_groups_of_movers(away_m, second_motion, groups):
    objects = objects_at((0, 0, 0), (away_m, 0, 0))
    motions = rows((1, 0, 0), second_motion)
    around = objects.positions, objects.owners
    assert mover_groups(objects, motions, *around).tolist() == groups
    nothing = objects_at()
    assert mover_groups(nothing, rows(), nothing.positions, nothing.owners).tolist() == []


def test_halves_of_a_long_mover_touch_though_few_of_their_points_are_chosen():
    halves, motions = objects_at((0, 0, 0), (3.5, 0, 0)), rows((1, 0, 0), (1, 0, 0))
    points = np.concatenate([halves.positions, halves.positions[:1] + np.float32(0.1)])
    assert mover_groups(halves, motions, points, np.append(halves.owners, 1)).tolist() == [0, 0]
