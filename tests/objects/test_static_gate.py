"""Which objects may move, and which do: each rule by itself."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import SETTINGS, objects_of, prepared, rows, surface, target

from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets
from mnsf_ros.objects.static_gate import moves, suspects


def judged(near, motion=(0.5, 0.0, 0.0), past=()):
    """One object whose motion leaves so much unexplained, metres."""
    return JudgedMotions(
        rows(motion), np.array([near]), np.array([past]).reshape(1, -1), np.zeros(1, np.float32)
    )


def gate(standing, moving, free=1.0, **changes):
    """Whether it moves; by default other sweeps saw through the place where it is."""
    settings = SETTINGS.changed({f"objects.{name}": value for name, value in changes.items()})
    return bool(moves(standing, moving, np.array([free]), settings.objects)[0])


class TestMoves:
    """Standing leaves 0.2 m, motion 0.02 m: but for the one thing tested, it moves."""

    STANDING = judged((0.2, 0.2))

    def test_a_motion_that_explains_far_more(self):
        assert gate(self.STANDING, judged((0.02, 0.02)))

    def test_must_leave_less_than_a_share_of_what_standing_leaves(self):
        assert gate(self.STANDING, judged((0.129, 0.129)))
        assert not gate(self.STANDING, judged((0.131, 0.131)))
        assert gate(self.STANDING, judged((0.131, 0.131)), max_unexplained=0.7)

    def test_share_is_of_the_mean_of_both_neighbors(self):
        """Hidden in one of them, an object may be well explained in the other."""
        assert gate(self.STANDING, judged((0.0, 0.25)))
        assert not gate(self.STANDING, judged((0.0, 0.27)))

    def test_must_be_worth_a_centimetre(self):
        assert gate(judged((0.016, 0.016)), judged((0.005, 0.005)))
        assert not gate(judged((0.014, 0.014)), judged((0.005, 0.005)))

    @pytest.mark.parametrize(("length_m", "is_moving"), [(0.051, True), (0.049, False)])
    def test_must_be_longer_than_five_centimetres(self, length_m, is_moving):
        assert gate(self.STANDING, judged((0, 0), (0, -length_m, 0))) is is_moving

    @pytest.mark.parametrize(("cost_m", "is_moving"), [(0.174, True), (0.176, False)])
    def test_must_explain_the_object_indeed(self, cost_m, is_moving):
        assert gate(judged((0.5, 0.5)), judged((cost_m, cost_m))) is is_moving

    @pytest.mark.parametrize(("climb_m", "is_moving"), [(0.24, True), (-0.26, False)])
    def test_must_stay_on_the_road(self, climb_m, is_moving):
        assert gate(self.STANDING, judged((0, 0), (0.5, 0, climb_m))) is is_moving

    @pytest.mark.parametrize(("past_m", "is_moving"), [(0.125, True), (0.127, False)])
    def test_must_explain_the_past_as_well(self, past_m, is_moving):
        standing = judged((0.2, 0.2), past=(0.3,))
        assert gate(standing, judged((0.02, 0.02), past=(past_m,)), free=0.0) is is_moving

    def test_what_the_past_explains_without_motion_stands(self):
        standing, moving = judged((0.2, 0.2), past=(0.0,)), judged((0.02, 0.02), past=(0.0,))
        assert not gate(standing, moving, free=0.0)

    @pytest.mark.parametrize(("free", "is_moving"), [(0.21, True), (0.19, False)])
    def test_the_past_has_no_veto_if_places_were_seen_through(self, free, is_moving):
        """Then it does not show the object because that was hidden, or beside another one."""
        standing = judged((0.2, 0.2), past=(0.3,))
        assert gate(standing, judged((0.02, 0.02), past=(0.3,)), free=free) is is_moving

    def test_without_such_evidence_motion_must_be_clearer(self):
        assert gate(self.STANDING, judged((0.09, 0.09)), free=0.0)
        assert not gate(self.STANDING, judged((0.092, 0.092)), free=0.0)

    def test_none_at_all(self):
        nothing = JudgedMotions(rows(), np.zeros((0, 2)), np.zeros((0, 0)), np.zeros(0))
        assert moves(nothing, nothing, np.zeros(0), SETTINGS.objects).shape == (0,)


class TestSuspects:
    HERE, THERE = (8.0, 0.0, 0.0), (8.0, 0.3, 0.0)

    @pytest.fixture
    def suspect_count(self):
        """How many objects are suspects if the other sweeps show a box at these places."""

        def count(next_at, previous_at=None, past_at=None):
            current = prepared(surface(self.HERE))
            sweeps = [target(prepared(surface(next_at)), current)]
            if previous_at is not None:
                sweeps.append(target(prepared(surface(previous_at)), current, -1.0))
            past = [] if past_at is None else [target(prepared(surface(past_at)), current, -3.0)]
            found, standing = suspects(objects_of(current), Targets(sweeps, past))
            assert len(found) == len(standing.motions) == len(standing.near)
            assert standing.near.shape[1] == len(sweeps)
            assert standing.past.shape[1] == len(past)
            assert not standing.motions.any()
            return len(found)

        return count

    def test_what_no_sweep_explains_is_one(self, suspect_count):
        assert suspect_count(self.THERE) == 1
        assert suspect_count(self.THERE, self.THERE) == 1
        assert suspect_count(self.THERE, self.THERE, self.THERE) == 1

    def test_what_one_sweep_explains_is_none(self, suspect_count):
        assert suspect_count(self.HERE) == 0
        assert suspect_count(self.THERE, self.HERE) == 0
        assert suspect_count(self.HERE, self.THERE) == 0
        assert suspect_count(self.THERE, self.THERE, self.HERE) == 0

    def test_costs_are_those_of_standing_still(self):
        current = prepared(surface(self.HERE))
        there = target(prepared(surface(self.THERE)), current)
        objects = objects_of(current)
        _, standing = suspects(objects, Targets([there], []))
        assert standing.cost == pytest.approx(there.unexplained(objects))
