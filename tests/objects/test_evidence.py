# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How likely objects move: what speaks for it, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface

from mnsf_ros.objects.evidence import evidence, moving_scores
from mnsf_ros.objects.expectation import Expectation
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.visibility import Visibility

PERSON = (0.4, 0.4, 1.7)


def judged(motion, near, past):
    nothing = np.zeros(1, np.float32)
    return JudgedMotions(rows(motion), np.array([near]), np.array([past]), nothing)


def score(
    size, motion, standing, moving, *, free=0.0, visible=(1.0, 1.0), reflects=0, is_part=False
):
    """Logarithm of the odds that one object without a track moves.

    `standing` and `moving` are residuals in the neighbouring and in the older sweeps.
    """
    objects = objects_of(prepared(surface((10.0, 0.0, 0.0), size=size)))
    unknown = Expectation(np.zeros(1, bool), rows((0, 0, 0)), np.zeros(1))
    still = judged((0, 0, 0), *standing)
    suspects = Suspects(np.zeros(1, np.int64), objects, still, unknown)
    seen = Visibility(np.array([free]), np.array([visible]), np.array([reflects]))
    features = evidence(suspects, judged(motion, *moving), seen, np.array([is_part]))
    return moving_scores(features)[0]


class TestSlowWalker:
    """0.6 m/s: noise in the neighbouring sweeps, clear in the older ones."""

    STANDING, MOVING = ((0.005, 0.005), (0.1, 0.3)), ((0.004, 0.005), (0.005, 0.01))

    def test_moves_by_the_older_sweeps_alone(self):
        assert score(PERSON, (0.06, 0, 0), self.STANDING, self.MOVING) > 0.5

    def test_is_less_likely_where_it_may_have_been_hidden(self):
        open_, hidden = (
            score(PERSON, (0.06, 0, 0), self.STANDING, self.MOVING, visible=visible)
            for visible in ((1.0, 1.0), (0.0, 0.0))
        )
        assert hidden < open_ - 1

    @pytest.mark.parametrize("size", [(0.5, 0.01, 2.0), (0.5, 0.6, 0.01)], ids=["wall", "crown"])
    def test_is_no_strip_of_a_wall_and_no_single_ring(self, size):
        assert score(size, (0.06, 0, 0), self.STANDING, self.MOVING) < 0


def test_without_older_sweeps_chance_matches_grow_with_the_square_of_the_motion():
    standing, moving = ((0.2, 0.2), ()), ((0.06, 0.06), ())
    near, far = (score(PERSON, (each, 0, 0), standing, moving, visible=()) for each in (1, 3))
    assert far - near == pytest.approx(-2 * np.log(3))


def test_part_of_a_wall_that_came_into_view_does_not_move():
    """It fits a long motion in all sweeps, but nobody saw through its place."""
    standing, moving = ((0.01, 0.35), (0.4, 0.4)), ((0.01, 0.02), (0.02, 0.02))
    strip = score((0.7, 0.04, 1.4), (0.8, 0, 0), standing, moving, visible=(0.2, 0.2))
    assert strip < 0
    assert score(PERSON, (0.8, 0, 0), standing, moving, free=2.0) > 2


def test_what_a_window_reflects_does_not_move():
    standing, moving = ((0.1, 0.1), (0.3, 0.3)), ((0.01, 0.02), (0.02, 0.02))
    seen, in_part, reflected = (
        score((4.0, 0.1, 1.5), (0.8, 0, 0), standing, moving, free=0.5, reflects=reflects)
        for reflects in (0, 1, 2)
    )
    assert reflected < in_part < 0 < seen


def test_a_free_place_is_no_evidence_for_a_part_that_was_cut_out_for_it():
    """The edge of a pane in a shop front; a pedestrian who leaves one is clear without it."""
    edge = (0.16, 0.15, 1.65), (0.23, 0, 0), ((0.004, 0.159), (0.159, 0.155))
    left = (0.0, 0.042), (0.013, 0.014)
    assert score(*edge, left, free=1.8, is_part=True) < 0 < score(*edge, left, free=1.8)
    walker = (0.3, 0.3, 1.5), (0.1, 0, 0), ((0.01, 0.1), (0.2, 0.3)), ((0.0, 0.0), (0.01, 0.02))
    assert score(*walker, free=1.8, is_part=True) > 1


def test_none_at_all():
    objects = objects_of(prepared(surface((10.0, 0.0, 0.0)))).only(np.zeros(1, bool))
    nothing = JudgedMotions(rows(), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.float32))
    unknown = Expectation(np.zeros(0, bool), rows(), np.zeros(0))
    suspects = Suspects(np.zeros(0, np.int64), objects, nothing, unknown)
    seen = Visibility(np.zeros(0), np.zeros((0, 2)), np.zeros(0, bool))
    scores = moving_scores(evidence(suspects, nothing, seen, np.zeros(0, bool)))
    assert scores.shape == (0,)
