# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Crop and ground. Defaults of the ground: 8 m window, 0.2 m margin."""

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import crop_mask, ground_mask, kept_mask

SETTINGS = Settings()
GROUND = SETTINGS.ground
MARGIN_M = GROUND.margin_m


def crop_of(min_range_m=5, max_range_m=50, min_height_m=-2, max_height_m=4):
    names = ("min_range_m", "max_range_m", "min_height_m", "max_height_m")
    values = (min_range_m, max_range_m, min_height_m, max_height_m)
    changes = {f"crop.{name}": value for name, value in zip(names, values, strict=True)}
    return SETTINGS.changed(changes).crop


def inside(*points, **limits):
    points = np.array(points, dtype=np.float32).reshape(-1, 3)
    return crop_mask(points, crop_of(**limits)).tolist()


def above(value):
    return float(np.nextafter(np.float32(value), np.float32(np.inf)))


def below(value):
    return float(np.nextafter(np.float32(value), np.float32(-np.inf)))


def test_crop_has_its_limits_inside_and_its_range_is_horizontal():
    # (3, 4) and (30, 40) are exactly 5 and 50 m away.
    assert inside((3, 4, 0), (-30, 40, 0), (0, -5, -2), (50, 0, 4)) == [True] * 4
    beyond = (below(5), 0, 0), (0, above(50), 0), (9, 0, below(-2)), (9, 0, above(4))
    assert inside(*beyond) == [False] * 4
    assert inside((3, 3.9, 4), (49, 0, 4)) == [False, True]
    assert inside((9, 0, 0.1), (9, 0, 0.7), min_height_m=0.1, max_height_m=0.7) == [True, True]
    huge = [(huge, huge, 0) for huge in (1e7, 1e20, -3e38)]
    assert inside(*huge, (9, 0, 1e7), (9, 0, -3e38)) == [False] * 5
    assert inside() == []


def test_kept_points_are_inside_the_crop_and_no_ground(make_scene):
    # A point at 10,000 km would leave the ground map with a single cell for the whole street.
    outside = np.float32([(500, 0, 0), (0, 0, 30), (0.1, 0, 0), (1e7, 0, 0), (0, 1e20, -1e20)])
    near = make_scene().current
    kept = kept_mask(np.vstack([outside, near]), SETTINGS)
    assert not kept[: len(outside)].any()
    np.testing.assert_array_equal(kept[len(outside) :], ~is_ground(near))
    assert 0 < kept.sum() < len(near)
    with_ground = SETTINGS.changed({"ground.remove": False})
    assert kept_mask(near, with_ground).all()


def is_ground(points, settings=GROUND):
    return ground_mask(np.asarray(points, dtype=np.float32), settings)


def grid(x, y, height=lambda x, y: 0 * x):
    """Points over the values of `x` and `y`, at a height that is a function of both."""
    xs, ys = np.meshgrid(x, y)
    return np.stack([xs, ys, height(xs, ys) + 0.0], axis=-1).reshape(-1, 3)


def plane(height=lambda x, y: 0 * x):
    """30 m by 30 m, 36 points per square metre."""
    return grid(np.linspace(-15, 15, 180), np.linspace(-15, 15, 180), height)


def solid(x, y, z):
    """Walls and roof of a box between the pairs of limits, points at most 0.1 m apart."""
    xs, ys, zs = (np.linspace(*limits, round(10 * np.ptp(limits)) + 1) for limits in (x, y, z))
    walls = [face for end in x for face in np.broadcast_arrays(end, ys[:, None], zs)]
    sides = [face for end in y for face in np.broadcast_arrays(xs[:, None], end, zs)]
    roof = np.broadcast_arrays(xs[:, None], ys, z[1])
    faces = [walls[:3], walls[3:], sides[:3], sides[3:], roof]
    return np.vstack([np.stack(face, axis=-1).reshape(-1, 3) for face in faces])


def without_floor(ground, x, y):
    """The ground that a lidar sees: none under a box."""
    within = (ground[:, 0] > x[0]) & (ground[:, 0] < x[1])
    return ground[~(within & (ground[:, 1] > y[0]) & (ground[:, 1] < y[1]))]


@pytest.mark.parametrize(
    "height",
    [
        lambda x, _: 0 * x + 500,
        lambda x, _: 0.1 * x,
        lambda x, y: 0.07 * x - 0.07 * y,
        # At most 20 % steep, well below the 25 % of max_slope.
        lambda x, _: 1.5 * np.sin(x / 7.5),
    ],
    ids=["plane", "slope", "diagonal slope", "hill"],
)
def test_terrain_with_noise_below_the_margin_is_ground(height):
    points = plane(height)
    points[:, 2] += np.random.default_rng(0).uniform(0, 0.4 * MARGIN_M, len(points))
    assert is_ground(points).all()


CARS = {
    "car": ((2, 6.4), (-1, 0.8), (0, 1.5)),
    "person": ((0, 0.4), (0, 0.5), (0, 1.7)),
    "wall across the whole scene": ((-15, 15), (7, 7.2), (0, 3)),
}


@pytest.mark.parametrize("rise", [0, 0.1], ids=["plane", "slope"])
@pytest.mark.parametrize("box", CARS.values(), ids=CARS)
def test_objects_narrower_than_the_window_are_above_the_ground(box, rise):
    x, y, _ = box
    floor = without_floor(plane(), x, y)
    thing = solid(*box)
    points = np.vstack([floor, thing])
    points[:, 2] += rise * points[:, 0]
    ground = is_ground(points)
    assert ground[: len(floor)].all()
    # The foot of a wall is within the margin, plus the rise of the slope inside a cell.
    is_above = thing[:, 2] > MARGIN_M + 2 * rise * GROUND.cell_size_m + 1e-4
    assert is_above.any()
    assert not ground[len(floor) :][is_above].any()


@pytest.mark.parametrize("far", [1e5, 1e7, 1e20, 3e38])
def test_giant_extent_is_binned_coarser_instead_of_taking_all_memory(far):
    # Two heaps, each of the size of a point now: points high above the lowest point of their
    # heap are no ground.
    heap = np.array([(0, 0, 0), (0, 0, 2), (0, 0, 0.1)])
    mask = is_ground(
        np.vstack([np.add(heap, (x, y, 0)) for x, y in ((0, 0), (far, far), (-far, 0))])
    )
    assert mask.tolist() == [True, False, True] * 3


def slow_ground_mask(points, settings):
    """The definition, cell by cell: the highest cone that stays below all points near it."""
    cells = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / settings.cell_size_m)
    lowest = {}
    for cell, height in zip(map(tuple, cells.astype(int)), points[:, 2], strict=True):
        lowest[cell] = min(height, lowest.get(cell, np.inf))
    width, depth = cells.max(axis=0).astype(int) + 1
    radius = round(settings.window_m / 2 / settings.cell_size_m)
    rise = settings.max_slope * settings.cell_size_m

    def near(cell, radius=radius):
        for x in range(max(0, cell[0] - radius), min(width, cell[0] + radius + 1)):
            for y in range(max(0, cell[1] - radius), min(depth, cell[1] + radius + 1)):
                yield (x, y), rise * (abs(x - cell[0]) + abs(y - cell[1]))

    def bottom(cell):
        """The lowest cone from above all cells around, for a cell with a point."""
        return min(
            max(lowest[third] - climb for third, climb in near(other, 1) if third in lowest) + step
            for other, step in near(cell, 1)
        )

    lifted = {cell: bottom(cell) for cell in lowest}
    lowest = {
        cell: lifted[cell] if lifted[cell] - height > settings.margin_m else height
        for cell, height in lowest.items()
    }

    def apex(cell):
        return min(lowest.get(other, np.inf) + climb for other, climb in near(cell))

    heights = {
        cell: max(apex(other) - climb for other, climb in near(cell)) + settings.margin_m
        for cell in lowest
    }
    limits = [heights[tuple(cell)] for cell in cells.astype(int)]
    return points[:, 2] <= limits


@pytest.mark.parametrize("seed", range(3))
def test_ground_is_the_same_as_its_definition(seed):
    settings = SETTINGS.changed({"ground.window_m": 3, "ground.margin_m": 0.3}).ground
    points = np.random.default_rng(seed).uniform((0, -4, 0), (9, 4, 2), (120, 3))
    points = points.astype(np.float32)
    expected = slow_ground_mask(points.astype(np.float64), settings)
    assert 0 < expected.sum() < len(points)
    np.testing.assert_array_equal(is_ground(points, settings), expected)
