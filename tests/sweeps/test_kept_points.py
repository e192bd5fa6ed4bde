# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Crop and ground. Defaults of the ground: cells of 0.5 m, 8 m window, 0.2 m margin."""

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.ground_surface import GroundSurface, ground_mask
from mnsf_ros.sweeps.kept_points import crop_mask, fit_mask, kept_mask
from mnsf_ros.sweeps.sweep import Sweep

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


def test_the_own_body_is_not_fitted(make_scene):
    near = make_scene().current
    body = np.random.default_rng(0).uniform((-1, -1, -0.5), (-0.6, 1, 0), (50, 3))
    sweep = Sweep(np.vstack([body.astype(np.float32), near]))
    boxed = SETTINGS.changed({"crop.own_body": "9 9 9 9 9 9; -0.5 -1 0 -1 1 -0.5"})
    plain, fitted = (fit_mask(sweep, each) for each in (SETTINGS, boxed))
    np.testing.assert_array_equal(np.flatnonzero(plain & ~fitted), np.arange(50))


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
        # 20 % steep, its crests bent with a radius of 75 m.
        lambda x, _: 3 * np.sin(x / 15),
        lambda x, _: 0.2 * np.maximum(x, 0),
    ],
    ids=["plane", "slope", "diagonal slope", "hill", "foot of a ramp"],
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


@pytest.mark.parametrize("rise", [(0, 0), (0.2, 0), (-0.1, 0.05)])
def test_slopes_and_heights_are_those_of_the_ground_also_beyond_it(rise):
    along, across = rise
    points = plane(lambda x, y: along * x + across * y).astype(np.float32)
    places = np.float32([(0, 0, 0), (9, -9, 5), (100, 0, 0), (-1e9, 1e9, 0)])
    surface = GroundSurface(points, GROUND)
    np.testing.assert_allclose(surface.slopes(places), [rise] * len(places), atol=0.01)
    off_m = surface.heights(places) - (places[:, 2] - places[:, :2] @ np.float32(rise))
    # The lowest point of a cell on a slope is below its middle.
    assert (np.abs(off_m) <= 0.05 + 0.01 * np.abs(places[:, :2]).sum(axis=1)).all()


def test_without_points_the_ground_is_level():
    surface = GroundSurface(np.zeros((0, 3), np.float32), GROUND)
    assert surface.heights(np.zeros((0, 3), np.float32)).shape == (0,)
    assert surface.slopes(np.float32([(1, 2, 3)])).tolist() == [[0, 0]]


RINGS = np.radians(np.arange(-15, 0, 2))
HEIGHT_M = 1.8


def seen(distance_m):
    """What eight beams see of flat ground, and of a car's rear, 1.8 m wide and 1.5 m high."""
    azimuths, elevations = (axis.ravel() for axis in np.meshgrid(np.radians(range(360)), RINGS))
    azimuths = azimuths / 5 + np.radians(-36)
    ranges = -HEIGHT_M / np.tan(elevations)
    forward = ranges * np.cos(azimuths)
    at_car = distance_m / np.cos(azimuths)
    is_beside = np.abs(distance_m * np.tan(azimuths)) > 0.9
    is_above = HEIGHT_M + at_car * np.tan(elevations) > 1.5
    is_car = (forward > distance_m) & ~is_beside & ~is_above
    ranges = np.where(is_car, at_car, ranges)
    directions = np.stack([np.cos(azimuths), np.sin(azimuths), np.tan(elevations)], axis=1)
    return ranges[:, None] * directions, is_car


@pytest.mark.parametrize("distance_m", [9.0, 13.0, 18.0, 25.0])
def test_between_the_rings_of_few_beams_ground_is_where_it_is_beside_the_car(distance_m):
    points, is_car = seen(distance_m)
    ground = is_ground(points)
    is_high = is_car & (points[:, 2] > MARGIN_M + 0.05 - HEIGHT_M)
    assert is_high.sum() >= 10
    assert not ground[is_high].any()
    assert ground[~is_car].all()


def test_what_a_wet_road_mirrors_is_not_the_ground():
    street = plane()
    rng = np.random.default_rng(0)
    mirrored = rng.uniform((-10, -10, -2.5), (10, 10, -0.5), (60, 3))
    # A car's image is a patch of them.
    patch = grid(np.linspace(3, 4.5, 9), np.linspace(1, 2, 6), lambda x, _: -1.2 + 0 * x)
    assert is_ground(np.vstack([street, mirrored, patch])).all()


def slow_heights(points, settings):
    """The definition, block by block: weighted least squares of all cells near it."""
    low = points[:, :2].min(axis=0)
    cells = np.floor((points[:, :2] - low) / settings.cell_size_m).astype(int)
    lowest = {}
    for cell, height in zip(map(tuple, cells), points[:, 2], strict=True):
        lowest[cell] = min(height, lowest.get(cell, np.inf))
    blocks = {
        (x, y) for x in range(cells[:, 0].max() // 4 + 1) for y in range(cells[:, 1].max() // 4 + 1)
    }
    planes = {block: np.array([np.median(list(lowest.values())), 0, 0]) for block in blocks}

    def terms(place, block):
        return np.array([1, *(np.array(place) - (4 * np.array(block) + 1.5))])

    def weight(cell, height, tolerance_m):
        block = cell[0] // 4, cell[1] // 4
        off = (height - terms(cell, block) @ planes[block]) / tolerance_m
        return (1 + off**2) ** (-2 if off > 0 else -1)

    for level in (4, 3, 2, 1, 0):
        reach = max(1, round(settings.window_m * 2**level / 2 / (4 * settings.cell_size_m)))
        weights = {
            cell: weight(cell, height, settings.margin_m * 2**level)
            for cell, height in lowest.items()
        }
        after = {}
        for block in blocks:
            near = [
                cell
                for cell in lowest
                if max(abs(cell[0] // 4 - block[0]), abs(cell[1] // 4 - block[1])) <= reach
            ]
            left = np.array([*(terms(cell, block) for cell in near), *np.diag((1.0, 4.0, 4.0))])
            right = np.array([*(lowest[cell] for cell in near), *(planes[block] * (1, 4, 4))])
            root = np.sqrt([*(weights[cell] for cell in near), 1, 1, 1])
            after[block] = np.linalg.lstsq(left * root[:, None], right * root, rcond=None)[0]
        planes = after
    places = (points[:, :2] - low) / settings.cell_size_m - 0.5
    blocks_of = map(tuple, cells // 4)
    ground = [
        terms(place, block) @ planes[block] for place, block in zip(places, blocks_of, strict=True)
    ]
    return points[:, 2] - ground


@pytest.mark.parametrize("seed", range(3))
def test_heights_are_the_same_as_their_definition(seed):
    settings = SETTINGS.changed({"ground.window_m": 3, "ground.margin_m": 0.3}).ground
    points = np.random.default_rng(seed).uniform((0, -4, 0), (9, 4, 2), (120, 3))
    points = points.astype(np.float32)
    heights = GroundSurface(points, settings).heights(points)
    assert 0 < np.count_nonzero(heights < settings.margin_m) < len(points)
    np.testing.assert_allclose(
        heights, slow_heights(points.astype(np.float64), settings), atol=1e-4
    )
