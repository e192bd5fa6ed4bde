# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Another sweep as a target, votes for a shift, and the fields that settle it."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from box_street import pose
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.objects.motion_field import MotionField, fit_motion_field
from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets, best_of, fuse_motions, judge
from mnsf_ros.objects.motion_votes import voted_motions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.voting_grid import VotingGrid

BOX_AT = (10.0, 2.0, 0.0)
MOTION = np.array([0.9, -0.4, 0.0], np.float32)


def moved_box(factor=1.0):
    return surface(np.add(BOX_AT, factor * MOTION))


def left_by(motions, objects, other):
    """(K,) metres that motions leave unexplained, by a loop that the method does not use for it."""
    shifts = np.float32(other.steps) * motions
    each = objects.positions, objects.owners, shifts, other.from_current, objects.spacing
    sums, _, _ = other.sweep.grid.compared(*each, 0.5)
    return sums / objects.counts


@pytest.fixture(scope="module")
def current():
    return prepared(moved_box(0))


@pytest.fixture(scope="module")
def objects(current):
    return objects_of(current)


@pytest.fixture(scope="module")
def near(current):
    """The next and the previous sweep of a box that moves."""
    return [
        target(prepared(moved_box(1)), current),
        target(prepared(moved_box(-1)), current, -1.0),
    ]


class TestTarget:
    def test_what_is_there_is_explained(self, current, objects):
        assert target(current, current).unexplained(objects) == pytest.approx(0, abs=1e-6)

    def test_what_is_far_off_counts_as_half_a_metre_less_the_spacing(self, current, objects):
        away = target(prepared(surface((40, 0, 0))), current)
        expected = 0.5 - objects.spacing.mean()
        assert away.unexplained(objects) == pytest.approx([expected], abs=1e-4)

    def test_the_right_motion_explains_and_the_wrong_one_does_not(self, objects, near):
        for each in near:
            assert left_by(rows(MOTION), objects, each) == pytest.approx(0, abs=0.01)
            assert left_by(rows(-MOTION), objects, each) > 0.3
            assert each.unexplained(objects) > 0.1

    def test_the_sensor_s_own_motion_is_taken_out(self, current, objects):
        """The same place, seen from another one."""
        elsewhere = pose(3, -1, 0.2, yaw_deg=25)
        back = np.linalg.inv(elsewhere)
        seen = moved_box(1) @ back[:3, :3].T.astype(np.float32) + back[:3, 3].astype(np.float32)
        other = target(prepared(seen, world_from_sensor=elsewhere), current)
        np.testing.assert_allclose(other.from_current, back, atol=1e-12)
        assert left_by(rows(MOTION), objects, other) == pytest.approx(0, abs=0.01)
        pulls, counts = other.pulls(objects, rows(np.add(MOTION, (0, 0, 0.01))), 0.5)
        np.testing.assert_array_equal(counts, objects.counts)
        # Thinning moves a few points; the axes are those of the current sweep.
        np.testing.assert_allclose(pulls, [(0, 0, -0.01)], atol=3e-3)

    def test_points_out_of_reach_do_not_pull(self, current, objects):
        pulls, counts = target(current, current).pulls(objects, rows((50, 0, 0)), 0.4)
        assert counts.tolist() == [0]
        assert not pulls.any()


class TestVotingGrid:
    def test_a_step_adds_what_a_shift_does(self):
        points = np.random.default_rng(0).uniform(-5, 5, (50, 3)).astype(np.float32) * (1, 1, 0.1)
        grid = VotingGrid(points.astype(np.float32), margin_m=3.0)
        shifts = np.array([[1, 0], [0, 1], [-4, 3]])
        cells, _ = grid.cells_of(points.astype(np.float32))
        for shift, step in zip(shifts, grid.steps(shifts), strict=True):
            shifted = points + np.append(shift, 0) * grid.cell_m
            difference = grid.cells_of(shifted.astype(np.float32))[0] - cells
            # But for points on the edge of a cell.
            assert np.mean(difference == step) > 0.9

    @pytest.mark.parametrize("extent_m", [10.0, 2e3, 1e6])
    def test_memory_is_bounded_whatever_the_extent(self, extent_m, current):
        points = rows((0, 0, 0), (extent_m, extent_m, 50))
        grid = VotingGrid(points, margin_m=5.0)
        (occupied,) = grid.occupied([target(current, current)])
        assert occupied.nbytes < 50e6
        assert grid.cells_of(points)[0].max() < len(occupied)
        assert grid.cell_m >= extent_m / 1024

    def test_a_cell_above_and_below_a_point_counts_and_beside_it_does_not(self, current):
        single = prepared(np.repeat(rows((5, 0, 0)), 20, axis=0))
        grid = VotingGrid(rows((5, 0, 0), (8, 3, 1)), margin_m=2.0)
        (occupied,) = grid.occupied([target(single, single)])
        assert sum(int(column).bit_count() for column in occupied) == 3
        asked = rows((5, 0, 0), (5, 0, 0.3), (5, 0, -0.3), (5, 0, 0.7), (5.4, 0, 0))
        columns, levels = grid.cells_of(asked)
        assert (occupied[columns] & levels > 0).tolist() == [True, True, True, False, False]


def best_vote(objects, targets, reach_m=3.6):
    """The motion with most votes, none being known before."""
    return voted_motions(objects, targets, reach_m, np.zeros((len(objects), 3), np.float32), 1)[0]


class TestVotes:
    @pytest.mark.parametrize("factor", [1.0, 3.0, -2.0, 0.0])
    def test_find_the_shift_to_within_a_cell(self, current, objects, factor):
        sweeps = [prepared(moved_box(factor)), prepared(moved_box(-factor))]
        targets = [target(sweeps[0], current), target(sweeps[1], current, -1.0)]
        voted = best_vote(objects, targets)
        assert np.linalg.norm(voted - factor * MOTION, axis=1) < 0.35

    def test_do_without_a_previous_sweep(self, objects, near):
        voted = best_vote(objects, near[:1])
        assert np.linalg.norm(voted - MOTION, axis=1) < 0.35

    def test_take_the_short_way_where_nothing_tells(self, current, objects):
        away = target(prepared(surface((60, 40, 0))), current)
        np.testing.assert_array_equal(best_vote(objects, [away]), [[0, 0, 0]])

    @pytest.mark.parametrize("reach_m", [18.0, 2000.0])
    def test_of_a_long_time_need_a_bounded_memory(self, current, objects, reach_m):
        """Half a second at 36 m/s: all shifts times all points at once would be 500 MB."""
        many = objects_of(
            prepared(*(surface((x, y, 0)) for x in range(-60, 61, 8) for y in range(-60, 61, 8)))
        )
        tracemalloc.start()
        best_vote(many, [target(current, current)], reach_m)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 150e6

    def test_are_added_to_what_is_known_before(self, objects, near):
        base = rows(np.add(MOTION, (2.0, -1.0, 0.0)))
        (voted,) = voted_motions(objects, near, 3.6, base, 1)
        assert np.linalg.norm(voted - MOTION, axis=1) < 0.35

    def test_second_is_no_neighbor_of_the_first(self, objects, near):
        first, second = voted_motions(objects, near, 3.6, rows((0, 0, 0)), 2)
        assert np.linalg.norm(first - MOTION, axis=1) < 0.35
        assert np.abs(second - first).max() > 0.7

    def test_are_those_of_all_shifts_tried_one_by_one(self, near, current):
        many = objects_of(prepared(*(surface((10.0, y, 0)) for y in range(-40, 41, 8))))
        found = best_vote(many, near)
        some = many.thinner(24)
        grid = VotingGrid(some.positions, margin_m=3.6)
        radius = int(3.6 / grid.cell_m)
        side = range(-radius, radius + 1)
        shifts = [(x, y) for x in side for y in side if x * x + y * y <= radius * radius]
        votes = []
        for shift in shifts:
            met = np.zeros(len(some.owners))
            for each, sign in zip(grid.occupied(near), (1, -1), strict=True):
                columns, levels = grid.cells_of(some.positions)
                met += each[columns + grid.steps(np.array([shift]) * sign)] & levels > 0
            # Of equal ones the shorter; of equally long ones any.
            votes.append(some.sums(met) / some.counts - 0.02 * grid.cell_m * np.hypot(*shift))
        rows_found = [
            shifts.index(tuple(np.rint(motion[:2] / grid.cell_m).astype(int))) for motion in found
        ]
        best = np.max(votes, axis=0)
        np.testing.assert_allclose(np.array(votes)[rows_found, np.arange(len(many))], best)

    @pytest.mark.parametrize("far_m", [1e6, 1e20])
    def test_of_huge_coordinates_are_no_motion(self, near, far_m):
        places = np.concatenate([moved_box(0)[:20], moved_box(0)[:20] + np.float32(far_m)])
        owners, spacing = np.repeat([0, 1], 20), np.full(40, 0.1, np.float32)
        both = ObjectPoints(np.array([1, 2]), places, owners, spacing)
        voted = best_vote(both, near)
        assert np.isfinite(voted).all()
        assert not voted[1].any()


class TestMotionField:
    @pytest.mark.parametrize("steps", [1.0, -1.0, -0.5, 2.0])
    def test_recovers_a_known_shift(self, current, objects, steps):
        there = target(prepared(moved_box(steps)), current, steps)
        start = rows(np.add(MOTION, (0.15, 0.1, 0)))
        field = fit_motion_field(objects, there, start, 6)
        np.testing.assert_allclose(field.flows, [steps * MOTION], atol=0.02)
        assert field.num_matched.tolist() == objects.counts.tolist()

    def test_stays_where_nothing_is(self, current, objects):
        away = target(prepared(surface((40, 0, 0))), current)
        field = fit_motion_field(objects, away, rows(MOTION), 6)
        np.testing.assert_array_equal(field.flows, [MOTION])
        assert field.num_matched.tolist() == [0]

    def test_of_no_objects_is_empty(self, objects, near):
        none = objects.only(np.zeros(1, bool))
        field = fit_motion_field(none, near[0], rows(), 6)
        assert field.flows.shape == (0, 3)


class TestFusion:
    WRONG = rows((2.0, 2.0, 0.0))

    @pytest.mark.parametrize("wrong", ["forward", "backward", "neither"])
    def test_chooses_what_explains_both_neighbors(self, objects, near, wrong):
        matched = objects.counts
        forward = MotionField(self.WRONG if wrong == "forward" else rows(MOTION), matched)
        inverted = self.WRONG if wrong == "backward" else rows(MOTION)
        backward = MotionField(-inverted, matched)
        fused = fuse_motions(objects, Targets(near, ()), forward, backward, inverted, rows(MOTION))
        np.testing.assert_allclose(fused.motions, [MOTION], atol=1e-6)
        expected = 0 if wrong == "neither" else np.linalg.norm(self.WRONG - MOTION)
        assert fused.disagreement == pytest.approx([expected], abs=1e-5)

    def test_mean_is_weighted_by_what_was_matched(self, objects, near):
        """Three quarters of the points agree with the forward field."""
        off = rows((0.04, 0.0, 0.0))
        forward, backward = MotionField(rows(MOTION) + off, np.array([3])), np.array([1])
        inverted = rows(MOTION) - 3 * off
        fused = fuse_motions(
            objects,
            Targets(near, ()),
            forward,
            MotionField(-inverted, backward),
            inverted,
            rows(MOTION),
        )
        np.testing.assert_allclose(fused.motions, [MOTION], atol=1e-6)

    def test_fits_that_came_half_the_way_are_continued(self, objects, near):
        """Rings on the side of a vehicle look alike, and hold a fit back."""
        half, matched = rows(0.5 * MOTION), objects.counts
        fields = MotionField(half, matched), MotionField(-half, matched)
        fused = fuse_motions(objects, Targets(near, ()), *fields, half, rows((0, 0, 0)))
        np.testing.assert_allclose(fused.motions, [MOTION], atol=1e-6)

    def test_what_brakes_goes_as_the_neighbouring_sweeps_say_and_not_as_it_came(
        self, objects, near, current
    ):
        """0.3 s ago it was 0.3 m farther back than at its present speed."""
        faster = rows(1.1 * MOTION)
        past = [target(prepared(moved_box(-3.3)), current, -3.0)]
        matched = np.array([48])
        now = MotionField(rows(MOTION), matched), MotionField(-rows(MOTION), matched)
        for others, expected in (([], MOTION), ([faster], MOTION)):
            fused = fuse_motions(
                objects, Targets(near, past), *now, rows(MOTION), rows(MOTION), others
            )
            np.testing.assert_allclose(fused.motions, [expected], atol=1e-6)

    def test_what_is_slow_goes_as_it_came_if_neighbours_hardly_tell(self, objects, current):
        slow = rows(0.1 * MOTION)
        near = [target(prepared(moved_box(0.1 * step)), current, step) for step in (1.0, -1.0)]
        past = [target(prepared(moved_box(-0.6)), current, -6.0)]
        off, matched = slow + rows((0.03, 0.03, 0)), np.array([48])
        now = MotionField(off, matched), MotionField(-off, matched)
        fused = fuse_motions(objects, Targets(near, past), *now, off, off, [slow])
        np.testing.assert_allclose(fused.motions, slow, atol=1e-6)

    def test_what_has_no_match_at_all_is_no_division_by_zero(self, objects, near):
        nothing = MotionField(rows((0, 0, 0)), np.array([0]))
        none = rows((0, 0, 0))
        fused = fuse_motions(objects, Targets(near, ()), nothing, nothing, none, none)
        assert np.isfinite(fused.motions).all()

    def test_in_doubt_the_first_wins(self):
        first = judged(rows((1, 0, 0)), 0.1)
        assert first.better(judged(rows((2, 0, 0)), 0.098)).motions[0, 0] == 1
        assert first.better(judged(rows((2, 0, 0)), 0.097)).motions[0, 0] == 2

    def test_the_same_motion_again_is_no_better_and_not_judged(self, objects, near):
        first = judge(objects, Targets(near, ()), rows(MOTION * 0.8))
        assert first.limit(rows(MOTION * 0.8)) == [-np.inf]
        assert first.limit(rows(MOTION)) == first.total - 0.0025

    def test_a_limit_changes_only_what_is_above(self, objects, near):
        targets = Targets(near, near)
        motions = rows(MOTION * 0.8)
        exact = judge(objects, targets, motions)
        above = judge(objects, targets, motions, limit=exact.total * 1.001)
        np.testing.assert_array_equal(above.near, exact.near)
        np.testing.assert_array_equal(above.past, exact.past)
        for share in (0.999, 0.6, 0.1, 0.0, -1.0):
            assert judge(objects, targets, motions, limit=exact.total * share).total == [np.inf]

    def test_best_is_that_of_all_judged_in_full(self, objects, near):
        targets = Targets(near, near[:1])
        rng = np.random.default_rng(0)
        candidates = [rows(MOTION * factor) for factor in rng.uniform(0, 2, 8)]
        expected = first = judge(objects, targets, rows((0, 0, 0)))
        for each in candidates:
            expected = expected.better(judge(objects, targets, each))
        found = best_of(objects, targets, first, candidates)
        np.testing.assert_array_equal(found.motions, expected.motions)
        np.testing.assert_array_equal(found.near, expected.near)
        np.testing.assert_array_equal(found.past, expected.past)

    def test_residuals_are_those_of_each_target_alone(self, objects, near):
        motions = rows(MOTION * 0.8)
        judged = judge(objects, Targets(near, near[::-1]), motions)
        each = np.stack([left_by(motions, objects, item) for item in near], axis=1)
        np.testing.assert_array_equal(judged.near, each)
        np.testing.assert_array_equal(judged.past, each[:, ::-1])

    def test_without_others_the_first_is_best(self, objects, near):
        first = judge(objects, Targets(near, ()), rows(MOTION))
        assert best_of(objects, Targets(near, ()), first, []) is first

    def test_cost_is_the_mean_of_both_neighbors(self, objects, near):
        standing = judge(objects, Targets(near, near[:1]), rows((0, 0, 0)))
        each = [float(item.unexplained(objects)[0]) for item in near]
        assert standing.cost == pytest.approx([np.mean(each)])
        assert standing.past == pytest.approx(np.array([each[:1]]))


@pytest.mark.parametrize("is_seen", [np.greater, np.less])
def test_what_is_half_hidden_elsewhere_does_not_climb(current, objects, is_seen):
    """A pedestrian of whom a parked car hides the legs in one sweep, or who comes out from it."""
    motion = rows((0.12, 0.0, 0.0))
    whole = surface(np.add(BOX_AT, motion[0]))
    half = whole[is_seen(whole[:, 2], BOX_AT[2])]
    field = fit_motion_field(objects, target(prepared(half), current), motion, 4)
    assert abs(field.flows[0, 2]) <= 0.15 * np.hypot(*field.flows[0, :2]) + 1e-6


def judged(motions, cost):
    near = np.full((len(motions), 2), cost)
    return JudgedMotions(motions, near, near[:, :0], np.zeros(len(motions), np.float32))


@pytest.mark.parametrize(("climb_m", "expected_m"), [(0.04, 0.0), (-0.04, 0.0), (0.2, 0.15)])
def test_of_a_vertical_motion_what_may_be_noise_is_left_out(current, climb_m, expected_m):
    motion = rows((0.5, 0.0, climb_m))
    near = [target(prepared(surface(np.add(BOX_AT, motion[0]))), current)]
    field = MotionField(motion, np.array([48]))
    fused = fuse_motions(objects_of(current), Targets(near, ()), field, field, motion, motion)
    np.testing.assert_allclose(fused.motions, rows((0.5, 0.0, expected_m)), atol=1e-6)
