# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Hidden places, and evidence from sweep to sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface, table_of, target

from mnsf_ros.online.gate import evidence, free_space, moves, moving_log_odds
from mnsf_ros.online.motions import TrackPrior, best_of, judge
from mnsf_ros.online.suspects import with_suspects
from mnsf_ros.online.target import Targets
from mnsf_ros.online.travelling_views import are_travelling_views
from mnsf_ros.settings import Settings

PLACE = np.array([12.0, 0.0, 0.0])
# A number, and that of its whole.
ONE = (np.ones(1, np.int64), np.ones(1, np.int64))


def plate(x_m, y_m=0.0):
    """(N, 3) a plate across the line of sight, denser than any beams."""
    y, z = np.mgrid[-1:1:0.03, -1:1:0.03].reshape(2, -1)
    return np.stack([np.full(len(y), x_m), y + y_m, z], axis=1)


def patch(x_m, y_m=6.0, turn=0.0):
    """(N, 3) what is seen of a wall along the way, turned about its middle."""
    along, z = np.mgrid[-1:1:0.03, -1:1:0.03].reshape(2, -1)
    return np.stack([x_m + along * np.cos(turn), y_m + along * np.sin(turn), z], axis=1)


def suspects_of(targets, objects, track=(0, 0, 0), odds=0.0):
    """The only object, with a track that predicts a motion with some odds."""
    prior = TrackPrior(np.ones(1), rows(track), np.zeros(1), np.full(1, odds), np.full(1, 0.05))
    static = judge(objects, targets, rows((0, 0, 0)))
    return table_of(objects, prior, targets, static=static)


@pytest.mark.parametrize(
    ("parts", "motion", "least", "most"),
    [
        ([3 * plate(12)], (0, 0, 0), 0.4, 0.5),
        ([plate(5)], (0, 0, 0), 0.01, 0.11),
        ([], (0, -10, 0), 0.01, 0.11),
        # Where it is now the sensor looks, though nothing returned from there.
        ([plate(6, -6)], (0, 0, 0), 0.4, 0.5),
    ],
    ids=["seen through", "hidden", "out of view", "nothing returned"],
)
def test_hidden_place_says_little(parts, motion, least, most):
    current = prepared(plate(12))
    away = target(prepared(plate(12, 20), *parts), current)
    assert least < away.residuals(objects_of(current), rows(motion))[0] <= most


def slid(y_m=0.0):
    """A long side in front of a wall, slid along itself by so many metres."""
    return prepared(
        np.concatenate([plate(12, y_m + middle) for middle in (-4, -2, 0, 2, 4)]),
        *(plate(20, middle) for middle in range(-16, 17, 2)),
    )


def test_what_is_gone_tells_that_a_long_side_slid_along_itself():
    current, motion = slid(), rows((0, -0.4, 0))
    targets = Targets([target(slid(step * 0.4), current, -step) for step in (-1, 1)], [])
    objects = objects_of(current, max_size_m=20.0)
    nearest = objects.centers[:, 0] < 15
    table = with_suspects(table_of(objects), targets, max_suspects=9)
    assert table.open_rows == np.flatnonzero(nearest)
    side = objects.select(table.open_rows)
    assert targets.near[0].residuals(side, 0 * motion)[0] < 0.025
    assert free_space(side, targets, motion)[0] > 10 * max(
        *free_space(side, targets, 0 * motion), *free_space(side, targets, -motion), 1
    )


@pytest.mark.parametrize(
    ("sensor_m", "thing", "motion_m", "explained"),
    [
        (1.0, patch(0.0), (1.0, 0, 0), True),
        (1.0, patch(0.0), (0.7, 0, 0), True),
        (1.0, patch(0.0), (-1.0, 0, 0), False),
        (0.02, patch(0.0), (1.0, 0, 0), False),
        # A rear does not slide along itself.
        (1.0, patch(12.0, 0.0, np.pi / 2), (1.0, 0, 0), False),
        (1.0, surface(np.array([0.0, 6.0, 0.0])), (1.0, 0, 0), False),
    ],
    ids=["patch of a wall", "of a slanting wall", "oncoming", "to one that stands", "rear", "car"],
)
def test_what_is_seen_of_a_wall_travels_along_with_the_sensor(sensor_m, thing, motion_m, explained):
    moved = np.eye(4)
    moved[0, 3] = sensor_m
    current = prepared(thing)
    next_ = target(prepared(thing, world_from_sensor=moved), current)
    assert are_travelling_views(objects_of(current), rows(motion_m), next_) == [explained]


def test_what_travels_along_with_the_sensor_is_no_evidence_without_free_space():
    current, motion = prepared(patch(0.0)), rows((1.0, 0, 0))
    targets = Targets([target(prepared(patch(step)), current, step) for step in (1, -1)], [])
    table = suspects_of(targets, objects_of(current))
    table = replace(table, fitted=judge(table.points, targets, motion))

    def log_odds_of(num_new_or_gone, are_views):
        features = evidence(table, table.static, np.full(1, num_new_or_gone), np.full(1, are_views))
        return moving_log_odds(features)[0]

    assert log_odds_of(0.0, are_views=False) > log_odds_of(0.0, are_views=True)
    assert log_odds_of(1000.0, are_views=True) > 0 > log_odds_of(0.0, are_views=True)


@pytest.mark.parametrize(
    ("odds", "called"), [(-1.0, False), (0.0, False), (4.0, True), (40.0, True)]
)
def test_odds_of_the_track_count_in_the_next_sweep(odds, called):
    motion = np.array([0.0, 0.3, 0.0], np.float32)
    current = prepared(surface(PLACE))
    sides = [prepared(surface(PLACE + step * motion)) for step in (1, -1)]
    targets = Targets([target(sides[0], current, 1.0), target(sides[1], current, -1.0)], [])
    suspects, without = (
        suspects_of(targets, objects_of(current), motion, each) for each in (odds, 0.0)
    )
    moving = judge(suspects.points, targets, rows(motion))
    known, bias = (
        moving_log_odds(
            evidence(replace(table, fitted=moving), table.static, np.zeros(1), np.zeros(1, bool))
        )
        for table in (suspects, without)
    )
    # The evidence of this sweep alone is just not enough.
    log_odds = known - bias - 1.0
    assert log_odds[0] == pytest.approx(-1.0 + 0.4 * odds)
    is_followed, is_moving = moves(*ONE, moving.motions, log_odds, 0.1, Settings().objects)
    assert is_followed[0]
    assert is_moving[0] == called


@pytest.mark.parametrize(("odds", "goes_on"), [(-6.0, False), (0.0, False), (6.0, True)])
def test_where_a_sweep_does_not_tell_a_mover_goes_on_as_expected(odds, goes_on):
    # A side without ends lies on the other sweeps wherever it slid to.
    motion, current = rows((0, -0.2, 0)), prepared(plate(12))
    targets = Targets([target(prepared(plate(12)), current, step) for step in (1, -1)], [])
    suspects = suspects_of(targets, objects_of(current), motion[0], odds)
    static, prior = suspects.static, suspects.prior
    found = best_of(suspects.points, targets, static, [motion], prior)
    assert (found.motions == motion).all() == goes_on
    # One that it was shown to stand by does not.
    elsewhere = rows((0, -2.0, 0))
    suspects = suspects_of(targets, objects_of(current), elsewhere[0], odds)
    found = best_of(suspects.points, targets, static, [elsewhere], suspects.prior)
    assert not found.motions.any()


@pytest.mark.parametrize(("interval_s", "moves_by_m"), [(0.1, 0.025), (0.05, 0.0125), (0.5, 0.125)])
def test_how_slow_is_standing_does_not_depend_on_the_rate(interval_s, moves_by_m):
    def said(length_m):
        motion, log_odds = rows((length_m, 0, 0)), np.full(1, 9.0)
        return moves(*ONE, motion, log_odds, interval_s, Settings().objects)[1][0]

    assert said(moves_by_m)
    assert not said(0.7 * moves_by_m)


@pytest.mark.parametrize(
    ("log_odds", "followed", "moving"),
    [
        ((5.0, 4.0), [True, False], [True, False]),
        ((1.0, 1.5), [False, True], [False, True]),
        ((1.0, -0.5), [True, False], [True, False]),
        ((-1.0, 0.5), [False, True], [False, True]),
        ((-1.0, -0.5), [False, True], [False, False]),
        ((-3.0, -1.0), [False, True], [False, False]),
        ((-3.0, -4.0), [False, False], [False, False]),
    ],
)
def test_of_a_part_and_its_whole_the_likelier_moves(log_odds, followed, moving):
    settings = Settings().objects
    numbers, wholes, motions = np.array([3, 7]), np.array([3, 3]), rows((0.3, 0, 0), (0.3, 0, 0))
    is_followed, is_moving = moves(numbers, wholes, motions, np.array(log_odds), 0.1, settings)
    assert is_followed.tolist() == followed
    assert is_moving.tolist() == moving


def test_parts_of_what_cannot_move_are_judged_by_themselves():
    log_odds, motions = np.full(2, 4.0), rows((0.3, 0, 0), (0, 0.2, 0))
    _, is_moving = moves(
        np.array([7, 8]), np.array([3, 3]), motions, log_odds, 0.1, Settings().objects
    )
    assert is_moving.all()
