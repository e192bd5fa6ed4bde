# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Hidden places, and evidence from sweep to sweep."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.objects.decision import evidence, moves, moving_scores
from mnsf_ros.objects.motion_fusion import judge
from mnsf_ros.objects.motion_memory import Expectation
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.target import Targets
from mnsf_ros.settings import Settings

PLACE = np.array([12.0, 0.0, 0.0])


def plate(x_m, y_m=0.0):
    """(N, 3) a plate across the line of sight, denser than any beams."""
    y, z = np.mgrid[-1:1:0.03, -1:1:0.03].reshape(2, -1)
    return np.stack([np.full(len(y), x_m), y + y_m, z], axis=1)


def suspects_of(targets, objects, track=(0, 0, 0), odds=0.0):
    """The only object, with a track that expects a motion with some odds."""
    expected = Expectation(np.ones(1, np.bool_), rows(track), np.full(1, odds))
    standing = judge(objects, targets, rows((0, 0, 0)))
    return Suspects(np.arange(1), objects, standing, expected)


@pytest.mark.parametrize(("parts", "least", "most"), [([], 0.4, 0.5), ([plate(5)], 0.01, 0.11)])
def test_hidden_place_says_little(parts, least, most):
    current = prepared(plate(12))
    away = target(prepared(plate(12, 20), *parts), current)
    assert least < away.residuals(objects_of(current), rows((0, 0, 0)))[0] <= most


@pytest.mark.parametrize("motion", [(-2.5, 0, 0), (0, 2.5, 0)], ids=["nearer", "aside"])
def test_object_is_no_excuse_for_the_place_that_it_hides(motion):
    current = prepared(plate(12))
    targets = Targets([target(prepared(plate(12) + motion), current)], [])
    suspects = suspects_of(targets, objects_of(current))
    moving = judge(suspects.objects, targets, rows(motion))
    assert suspects.standing.cost[0] < 0.11 or motion[1]
    assert suspects.rather_than(moving, targets).standing.cost[0] > 0.4


@pytest.mark.parametrize(
    ("odds", "called"), [(-9.0, False), (0.0, False), (4.0, True), (40.0, True)]
)
def test_odds_of_the_track_count_in_the_next_sweep(odds, called):
    motion = np.array([0.0, 0.3, 0.0], np.float32)
    current = prepared(surface(PLACE))
    sides = [prepared(surface(PLACE + step * motion)) for step in (1, -1)]
    targets = Targets([target(sides[0], current, 1.0), target(sides[1], current, -1.0)], [])
    suspects, without = (
        suspects_of(targets, objects_of(current), motion, each) for each in (odds, 0.0)
    )
    moving = judge(suspects.objects, targets, rows(motion))
    features = evidence(suspects, moving, np.zeros(1), np.zeros(1, np.bool_))
    bias = moving_scores(evidence(without, moving, np.zeros(1), np.zeros(1, np.bool_)))
    # The evidence of this sweep alone is just not enough; a track that went wrong says nothing.
    scores = moving_scores(features) - bias - 1.0
    assert scores[0] == pytest.approx(-1.0 + 0.8 * min(max(odds, 0.0), 5.0))
    may_move, is_moving = moves(moving.motions, scores, 0.1, Settings().objects)
    assert may_move[0]
    assert is_moving[0] == called
