# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The points that stand for objects, and sums over them, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from box_street import pose
from small_scenes import SETTINGS, objects_of, prepared, rows, surface

from mnsf_ros.objects.object_points import ObjectPoints

# Objects 3, 5 and 8 of a sweep, with two, one and three points.
BY_HAND = ObjectPoints(
    numbers=np.array([3, 5, 8]),
    positions=rows((1, 0, 0), (3, 0, 0), (0, 10, 0), (-4, 0, 0), (-5, 0, 0), (-6, 0, 3)),
    owners=np.array([0, 0, 1, 2, 2, 2]),
    spacing=np.arange(6, dtype=np.float32),
)


class TestByHand:
    def test_counts_and_starts(self):
        assert len(BY_HAND) == 3
        assert BY_HAND.counts.tolist() == [2, 1, 3]
        assert BY_HAND.starts.tolist() == [0, 2, 3]

    def test_sums_of_numbers_and_of_rows(self):
        assert BY_HAND.sums(np.array([1, 2, 4, 8, 16, 32])).tolist() == [3, 4, 56]
        assert BY_HAND.sums(BY_HAND.positions).tolist() == [[4, 0, 0], [0, 10, 0], [-15, 0, 3]]

    def test_centers(self):
        assert BY_HAND.centers.tolist() == [[2, 0, 0], [0, 10, 0], [-5, 0, 1]]

    @pytest.mark.parametrize("wanted", [(1, 0, 1), (0, 1, 0), (0, 0, 0), (1, 1, 1)])
    def test_only(self, wanted):
        chosen = BY_HAND.only(np.array(wanted, bool))
        of_point = np.array(wanted, bool)[BY_HAND.owners]
        assert chosen.numbers.tolist() == [
            n for n, is_in in zip((3, 5, 8), wanted, strict=True) if is_in
        ]
        np.testing.assert_array_equal(chosen.positions, BY_HAND.positions[of_point])
        np.testing.assert_array_equal(chosen.spacing, BY_HAND.spacing[of_point])
        np.testing.assert_array_equal(chosen.counts, BY_HAND.counts[np.array(wanted, bool)])

    @pytest.mark.parametrize(
        ("number", "left"), [(0, []), (1, [3]), (2, [3, 8]), (3, [3, 5, 8]), (9, [3, 5, 8])]
    )
    def test_nearest(self, number, left):
        assert BY_HAND.numbers[BY_HAND.are_nearest(number)].tolist() == left

    def test_thinner_takes_evenly(self):
        assert BY_HAND.thinner(1).spacing.tolist() == [0, 2, 3]
        assert BY_HAND.thinner(2).spacing.tolist() == [0, 1, 2, 3, 5]
        assert BY_HAND.thinner(3).spacing.tolist() == [0, 1, 2, 3, 4, 5]

    @pytest.mark.parametrize("yaw_deg", [0, 37, 90])
    def test_extents_are_those_of_a_filled_box_however_it_is_turned(self, yaw_deg):
        size = (4.0, 0.2, 1.5)
        axes = [(np.arange(40) + 0.5) / 40 * length for length in size]
        box = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
        positions = (box @ pose(7, -3, 1, yaw_deg=yaw_deg)[:3, :3].T).astype(np.float32)
        owners = np.zeros(len(box), np.int64)
        objects = ObjectPoints(owners[:1], positions, owners, np.zeros(len(box), np.float32))
        assert np.ravel(objects.extents) == pytest.approx(size, rel=1e-3)
        assert objects.thicknesses == pytest.approx([0.2], rel=1e-3)

    def test_none_at_all(self):
        none = BY_HAND.only(np.zeros(3, bool))
        assert len(none) == 0
        assert none.sums(np.zeros((0, 3), np.float32)).shape == (0, 3)
        assert none.centers.shape == (0, 3)
        assert none.thinner(4).positions.shape == (0, 3)
        assert none.are_nearest(3).shape == (0,)


class TestOfASweep:
    @pytest.fixture(scope="class")
    def sweep(self):
        """Boxes of 200 and 40 points, a wall of 15 m, and a post of five points."""
        post = [(0, -12, height) for height in (0, 0.3, 0.6, 0.9, 1.2)]
        return prepared(
            surface((8, 0, 0), num_points=200),
            [(8 + 0.2 * x, 8 + 0.2 * y, 0) for x in range(8) for y in range(5)],
            [(0.1 * x, 20, 0.5 * z) for x in range(150) for z in range(3)],
            post,
        )

    def test_what_is_too_small_or_too_large_is_none(self, sweep):
        assert sweep.num_objects == 5
        assert len(objects_of(sweep, min_points=6)) == 2
        assert len(objects_of(sweep, min_points=5)) == 3
        assert sweep.sizes[1:] == pytest.approx([0.0, 14.9, 2.0, 1.4], abs=0.05)
        assert sweep.may_move.tolist() == [True, True, False, True, True]

    def test_at_most_so_many_points_stand_for_an_object(self, sweep):
        objects = objects_of(sweep, points_per_object=64)
        assert sorted(objects.counts.tolist()) == [40, 64]
        assert np.all(np.diff(objects.owners) >= 0)

    def test_points_are_those_of_their_object(self, sweep):
        objects = objects_of(sweep)
        for number, center in zip(objects.numbers, objects.centers, strict=True):
            own = sweep.sweep.xyz[sweep.objects() == number]
            assert np.linalg.norm(own.mean(axis=0) - center) < 0.3

    def test_spacing_grows_with_range(self, sweep):
        objects = objects_of(sweep)
        ranges = np.linalg.norm(objects.positions, axis=1)
        np.testing.assert_allclose(objects.spacing, 0.02 + 0.0035 * ranges, rtol=1e-5)

    def test_ground_and_what_was_cropped_belong_to_no_object(self):
        ground = np.stack(np.meshgrid(np.arange(-20, 21, 0.5), np.arange(-20, 21, 0.5), -1.8), -1)
        settings = SETTINGS.changed({"ground.remove": True, "crop.max_range_m": 50})
        box = surface((8, 0, -0.8), (2, 2, 1.9), 300)
        sweep = prepared(ground, box, rows((100, 0, 0)), settings=settings)
        objects = sweep.objects()
        num_ground = ground.size // 3
        assert not objects[:num_ground].any()
        assert objects[-1] == 0
        # What is less than 0.2 m above the ground is ground.
        above = box[:, 2] > -1.5
        assert set(objects[num_ground:-1][above].tolist()) == {1}

    def test_thinned_points_are_bounded_by_their_number(self):
        cloud = np.random.default_rng(0).uniform((-30, -30, 0), (30, 30, 3), (5000, 3))
        few = SETTINGS.changed({"objects.max_points": 1000})
        sweep = prepared(cloud, settings=few)
        assert 900 < len(sweep.thinned) <= 1000
        assert len(sweep.objects()) == 5000
