# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects may move, and what speaks for it."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.objects.evidence import evidence, moving_scores
from mnsf_ros.objects.expectation import Expectation
from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets, judge
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.visibility import Visibility

HERE, THERE = (8.0, 0.0, 0.0), (8.0, 0.5, 0.0)


def expectation(motion=(0, 0, 0), score=0.0):
    """What tracks expect of one object; none by default."""
    return Expectation(np.array([np.any(motion)]), rows(motion), np.array([score]))


def among(next_at, previous_at=None, past_at=(), expected=None):
    """The suspects if the other sweeps show a box at these places."""
    current = prepared(surface(HERE))
    near = [target(prepared(surface(next_at)), current)]
    if previous_at is not None:
        near.append(target(prepared(surface(previous_at)), current, -1.0))
    past = [
        target(prepared(surface(place)), current, -3.0 * number)
        for number, place in enumerate(past_at, start=1)
    ]
    found = Suspects.among(objects_of(current), Targets(near, past), expected or expectation())
    assert found.standing.near.shape == (len(found), len(near))
    assert found.standing.past.shape == (len(found), len(past))
    assert not found.standing.motions.any()
    return found


class TestSuspects:
    def test_what_no_sweep_explains_is_one(self):
        assert len(among(THERE)) == 1
        assert len(among(THERE, THERE)) == 1
        assert len(among(THERE, THERE, [THERE])) == 1
        assert len(among(THERE, THERE, [THERE, THERE])) == 1

    def test_without_older_sweeps_what_one_neighbor_explains_is_none(self):
        assert len(among(HERE)) == 0
        assert len(among(THERE, HERE)) == 0
        assert len(among(HERE, THERE)) == 0

    def test_slow_ones_are_told_by_older_sweeps(self):
        assert len(among(HERE, HERE, [(8.0, 0.3, 0.0), THERE])) == 1

    def test_what_one_older_sweep_explains_is_none(self):
        assert len(among(THERE, THERE, [HERE])) == 0
        assert len(among(THERE, THERE, [HERE, THERE])) == 0
        assert len(among(THERE, THERE, [THERE, HERE])) == 0

    def test_what_has_a_track_is_always_one(self):
        assert len(among(HERE, HERE, [HERE], expectation((0.5, 0, 0)))) == 1

    def test_residuals_are_those_without_motion(self):
        current = prepared(surface(HERE))
        others = [target(prepared(surface((8.0, y, 0.0))), current) for y in (0.2, 0.3, 0.4, 0.5)]
        objects, targets = objects_of(current), Targets(others[:2], others[2:])
        found = Suspects.among(objects, targets, expectation())
        expected = judge(objects, targets, rows((0, 0, 0)))
        np.testing.assert_allclose(found.standing.near, expected.near)
        np.testing.assert_allclose(found.standing.past, expected.past)


def score(near, past=(), free=0.0, motion=(0.5, 0, 0), expected=None):
    """Of one object that leaves 0.2 m in each sweep without motion."""
    objects = objects_of(prepared(surface(HERE)))
    zeros = np.zeros(1, np.float32)

    def judged(near, past, motion):
        return JudgedMotions(rows(motion), np.array([near]), np.array([past]).reshape(1, -1), zeros)

    standing = judged((0.2, 0.2), (0.3,) * len(past), (0, 0, 0))
    suspects = Suspects(np.zeros(1, int), objects, standing, expected or expectation())
    seen = Visibility(np.array([free]), np.ones((1, len(past))), np.zeros(1, bool))
    features = evidence(suspects, judged(near, past, motion), seen, np.zeros(1, bool))
    return float(moving_scores(features)[0])


class TestEvidence:
    @pytest.mark.parametrize("past", [(), (0.0,), (0.0, 0.0)])
    def test_a_motion_that_explains_all_and_came_through_free_space_is_clear(self, past):
        assert score((0.0, 0.0), past, free=1.0) > 1

    @pytest.mark.parametrize("past", [(), (0.3,), (0.3, 0.3)])
    def test_one_that_explains_no_more_than_none_is_not(self, past):
        assert score((0.2, 0.2), past) < -1

    def test_all_kinds_of_evidence_count(self):
        least = score((0.1, 0.1), (0.2,))
        assert score((0.02, 0.02), (0.2,)) > least
        assert score((0.1, 0.1), (0.1,)) > least
        assert score((0.1, 0.1), (0.2,), free=0.4) > least
        same = expectation((0.5, 0, 0), 3.0)
        assert score((0.1, 0.1), (0.2,), expected=same) > least

    def test_a_track_with_another_motion_counts_nothing(self):
        other = expectation((-0.5, 0, 0), 3.0)
        assert score((0.1, 0.1), (0.2,), expected=other) == score((0.1, 0.1), (0.2,))

    def test_is_bounded(self):
        assert score((0.0, 0.0), (0.0,), free=4.0) <= 6


def test_long_vehicle_whose_ends_alone_show_that_it_moves_is_a_suspect():
    """A flat side slides along itself: nine tenths of it look as if it stood."""
    side = np.stack(np.meshgrid(np.arange(0, 10, 0.2), 0.0, np.arange(0, 2, 0.2)), -1)
    side = side.reshape(-1, 3).astype(np.float32) + rows((5, 3, 0))
    current = prepared(side)
    objects = objects_of(current)
    past = [target(prepared(side - rows((shift, 0, 0))), current, steps)
            for shift, steps in ((1.0, -3.0), (2.0, -6.0))]  # fmt: skip
    targets = Targets([past[0]], past)
    assert len(Suspects.among(objects, targets, expectation())) == 1
    standing = [target(prepared(side), current, steps) for steps in (-3.0, -6.0)]
    none = Suspects.among(objects, Targets(standing[:1], standing), expectation())
    assert len(none) == 0
