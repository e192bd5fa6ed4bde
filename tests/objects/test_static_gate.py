# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects move: each rule by itself."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import SETTINGS, rows

from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.static_gate import moves


def judged(near, motion=(0.5, 0.0, 0.0), past=()):
    """One object whose motion leaves so much unexplained, metres."""
    return JudgedMotions(
        rows(motion), np.array([near]), np.array([past]).reshape(1, -1), np.zeros(1, np.float32)
    )


def gate(standing, moving, probability=0.9, **changes):
    """Whether it may move, and does."""
    settings = SETTINGS.changed({f"objects.{name}": value for name, value in changes.items()})
    scores = np.log([probability / (1 - probability)])
    may_move, is_moving = moves(standing, moving, scores, 0.1, settings.objects)
    return bool(may_move[0]), bool(is_moving[0])


class TestMoves:
    """Standing leaves 0.2 m, motion 0.02 m: but for the one thing tested, it moves."""

    STANDING = judged((0.2, 0.2))
    MOVING = judged((0.02, 0.02))

    def test_a_motion_that_explains_far_more(self):
        assert gate(self.STANDING, self.MOVING) == (True, True)

    @pytest.mark.parametrize(
        ("probability", "expected"),
        [
            (0.51, (True, True)),
            (0.49, (True, False)),
            (0.13, (True, False)),
            (0.11, (False, False)),
        ],
    )
    def test_must_be_likely_enough_and_is_followed_before(self, probability, expected):
        assert gate(self.STANDING, self.MOVING, probability) == expected

    def test_how_likely_is_a_setting(self):
        assert gate(self.STANDING, self.MOVING, 0.49, min_probability=0.45) == (True, True)
        assert gate(self.STANDING, self.MOVING, 0.89, min_probability=0.9) == (True, False)

    def test_must_leave_less_than_a_share_of_what_standing_leaves(self):
        assert gate(self.STANDING, judged((0.169, 0.169)))[1]
        assert not gate(self.STANDING, judged((0.171, 0.171)))[0]
        assert gate(self.STANDING, judged((0.171, 0.171)), max_unexplained=0.9)[1]

    def test_share_is_of_all_sweeps(self):
        standing = judged((0.1, 0.1), past=(0.3, 0.5))
        assert gate(standing, judged((0.1, 0.1), past=(0.3, 0.3)))[1]
        assert not gate(standing, judged((0.1, 0.1), past=(0.45, 0.35)))[0]

    @pytest.mark.parametrize(("length_m", "is_moving"), [(0.021, True), (0.019, False)])
    def test_must_be_longer_than_two_centimetres(self, length_m, is_moving):
        assert gate(self.STANDING, judged((0, 0), (0, -length_m, 0)))[1] is is_moving

    def test_must_not_be_up_or_down_alone(self):
        assert gate(self.STANDING, judged((0, 0), (0.01, 0.01, 0.1))) == (False, False)

    @pytest.mark.parametrize(("cost_m", "is_moving"), [(0.249, True), (0.251, False)])
    def test_must_explain_the_object_indeed(self, cost_m, is_moving):
        assert gate(judged((0.5, 0.5)), judged((cost_m, cost_m)))[1] is is_moving

    @pytest.mark.parametrize(("climb_m", "is_moving"), [(0.24, True), (-0.26, False)])
    def test_must_stay_on_the_road(self, climb_m, is_moving):
        assert gate(self.STANDING, judged((0, 0), (0.5, 0, climb_m)))[1] is is_moving

    @pytest.mark.parametrize(("speed_m_s", "is_moving"), [(43.0, True), (43.5, False)])
    def test_must_not_be_faster_than_the_fastest_object(self, speed_m_s, is_moving):
        # 36 m/s, and what fits may be off.
        assert gate(self.STANDING, judged((0, 0), (0.1 * speed_m_s, 0, 0)))[1] is is_moving

    def test_none_at_all(self):
        nothing = JudgedMotions(rows(), np.zeros((0, 2)), np.zeros((0, 0)), np.zeros(0))
        for mask in moves(nothing, nothing, np.zeros(0), 0.1, SETTINGS.objects):
            assert mask.shape == (0,)
