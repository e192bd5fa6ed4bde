# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Free space: what a sweep saw through, by a wall and a pole before it."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.objects.motion_fusion import Targets
from mnsf_ros.objects.range_view import RangeView
from mnsf_ros.objects.visibility import Visibility


def wall(x_m, width_m=8.0):
    """(N, 3) points of a wall across the view, a seventh of a degree apart."""
    y, z = np.meshgrid(np.arange(-width_m, width_m, 0.05), np.arange(-3.0, 3.0, 0.05))
    return np.stack([np.full(y.size, x_m), y.ravel(), z.ravel()], axis=1).astype(np.float32)


class TestRangeView:
    def test_what_is_before_a_wall_is_free_and_what_is_on_it_or_behind_is_not(self):
        view = RangeView(wall(20.0))
        places = rows((10, 0, 0), (19.0, 0, 0), (19.8, 0, 0), (20, 0, 0), (20.3, 0, 0), (30, 0, 0))
        assert view.free_and_hidden(places)[0].tolist() == [True, True, False, False, False, False]

    def test_where_no_return_came_from_nothing_is_known(self):
        places = rows((-10, 0, 0), (10, 0, 9), (0, 0, 5))
        assert not RangeView(wall(20.0)).free_and_hidden(places)[0].any()

    def test_what_is_behind_the_wall_is_hidden(self):
        view = RangeView(wall(20.0))
        places = rows((10, 0, 0), (20, 0, 0), (20.3, 0, 0), (20.5, 0, 0), (-30, 0, 0))
        assert view.free_and_hidden(places)[1].tolist() == [False, False, False, True, False]

    def test_the_nearest_return_of_a_direction_counts(self):
        pole = rows(*((8.0, 0.0, height) for height in np.arange(-0.7, 0.7, 0.02)))
        view = RangeView(np.concatenate([wall(20.0), pole]))
        assert not view.free_and_hidden(rows((10.0, 0.01, 0.0)))[0].any()
        assert view.free_and_hidden(rows((10.0, 1.0, 0.0)))[0].all()

    @pytest.mark.parametrize("place", [(-5.0, 0.0, 0.0), (-5.0, -0.0, 0.0), (0, 0, 5), (0, 0, -5)])
    def test_the_seam_behind_and_the_poles_above_and_below(self, place):
        far = rows(np.multiply(place, 2))
        assert RangeView(far).free_and_hidden(rows(place))[0].all()

    def test_the_range_of_a_direction_is_that_of_its_nearest_return(self):
        rng = np.random.default_rng(0)
        directions = rng.normal(size=(2000, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        # Not beside the edge of a cell, where rounding decides.
        azimuths = np.degrees(np.arctan2(directions[:, 1], directions[:, 0])) % 0.5
        elevations = np.degrees(np.arcsin(directions[:, 2])) % 1.0
        inside = (np.abs(azimuths - 0.25) < 0.24) & (np.abs(elevations - 0.5) < 0.49)
        directions = directions[inside]
        ranges = rng.uniform(5, 50, len(directions))
        view = RangeView((directions * ranges[:, None]).astype(np.float32))
        cells = np.floor(np.degrees(np.arctan2(directions[:, 1], directions[:, 0])) / 0.5) * 1000
        cells += np.floor(np.degrees(np.arcsin(directions[:, 2])))
        nearest = np.array([ranges[cells == cell].min() for cell in cells])
        margin = 0.2 + 0.01 * nearest
        for off, is_free, is_hidden in ((-1.2, True, False), (0, False, False), (1.2, False, True)):
            places = (directions * (nearest + off * margin)[:, None]).astype(np.float32)
            found = view.free_and_hidden(places)
            assert [mask.all() for mask in found] == [is_free, is_hidden]
            assert [mask.any() for mask in found] == [is_free, is_hidden]

    @pytest.mark.parametrize("far", [1e20, 3e38, np.inf, np.nan])
    def test_huge_coordinates_are_far_away(self, far):
        places = rows((far, 0, 0), (far, -far, far), (0, 0, -far), (20.0, 0, 0))
        view = RangeView(np.concatenate([wall(20.0), places]))
        assert not view.free_and_hidden(places)[0].any()
        assert view.free_and_hidden(rows((10, 0, 0)))[0].all()
        assert not RangeView(rows()).free_and_hidden(rows((1, 0, 0)))[0].any()


class TestVisibility:
    """A box before a wall: at (8, 0) now."""

    BOX = surface((8.0, 0.0, 0.0), size=(0.6, 0.6, 1.2))
    LEFT = surface((8.0, 1.5, 0.0), size=(0.6, 0.6, 1.2))
    RIGHT = surface((8.0, -1.5, 0.0), size=(0.6, 0.6, 1.2))
    FRONT = surface((4.0, 0.0, 0.0), size=(0.6, 2.0, 2.0))

    def free(self, next_, previous, motion):
        current = prepared(wall(20.0), self.BOX)
        objects = objects_of(current)
        near = [
            target(prepared(wall(20.0), part), current, steps)
            for part, steps in ((next_, 1.0), (previous, -1.0))
        ]
        return Visibility.of(objects, Targets(near, []), rows(motion)).free

    def test_what_moves_stands_where_others_saw_nothing(self):
        assert self.free(self.LEFT, self.RIGHT, (0, 1.5, 0)) == pytest.approx(2.0, abs=0.1)

    def test_a_wrong_motion_is_no_better_than_none(self):
        assert self.free(self.LEFT, self.RIGHT, (0, -2.5, 0)) == pytest.approx(0.0, abs=0.1)

    def test_what_stands_was_seen_through_by_nobody(self):
        assert self.free(self.BOX, self.BOX, (0, 1.5, 0)) < 0

    def test_what_was_hidden_was_not_seen_through(self):
        assert self.free(self.FRONT, self.FRONT, (0, 0.3, 0)) == pytest.approx(0.0, abs=0.01)

    SCREEN = surface((4.0, 0.0, 0.0), size=(0.6, 2.0, 2.0), num_points=20_000)

    @pytest.mark.parametrize(("past", "visible"), [(LEFT, 1.0), (SCREEN, 0.0)])
    def test_what_was_behind_something_was_not_visible_in_the_past(self, past, visible):
        current = prepared(wall(20.0), self.BOX)
        older = target(prepared(wall(20.0), past), current, -3.0)
        seen = Visibility.of(
            objects_of(current), Targets([target(current, current, 1.0)], [older]), rows((0, 0, 0))
        )
        assert seen.visible_past == pytest.approx(np.full((1, 1), visible), abs=0.05)

    def test_none_at_all(self):
        current = prepared(wall(20.0), self.BOX)
        near = [target(current, current, 1.0)]
        nothing = objects_of(current).only(np.zeros(1, bool))
        seen = Visibility.of(nothing, Targets(near, []), rows())
        assert seen.free.shape == (0,)
        assert seen.visible_past.shape == (0, 0)
