# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Selection, bounds and thinning of points, against plain answers."""

import numpy as np
import pytest

from mnsf_ros.geometry.point_sets import bounds, chosen_points, thinned


def points(number, seed=0):
    return np.random.default_rng(seed).normal(0, 8, (number, 3)).astype(np.float32)


@pytest.mark.parametrize("number", [0, 1, 1000])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_chosen_points_are_those_of_the_mask(number, share):
    xyz = points(number)
    mask = np.random.default_rng(1).random(number) < share
    found = chosen_points(xyz, mask)
    np.testing.assert_array_equal(found, xyz[mask])
    assert not np.shares_memory(found, xyz)
    if number:
        expected = (*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0))
        assert bounds(xyz) == pytest.approx(expected)


def plain(xyz, cell_m):
    cells = {}
    for point in xyz:
        key = tuple(np.floor(point.astype(np.float64) * (1 / cell_m))[::-1])
        cells.setdefault(key, []).append(point.astype(np.float64))
    means = [np.sum(points, axis=0) / len(points) for _, points in sorted(cells.items())]
    return np.array(means).reshape(-1, 3).astype(np.float32)


@pytest.mark.parametrize("cell_m", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("number", [0, 1, 3000])
def test_means_come_in_the_order_of_the_cells(number, cell_m):
    xyz = points(number)
    np.testing.assert_allclose(thinned(xyz, cell_m), plain(xyz, cell_m), rtol=1e-6)
    np.testing.assert_array_equal(thinned(xyz[::2], cell_m), thinned(xyz[::2].copy(), cell_m))


def test_far_places_are_in_the_outermost_cells():
    far = np.array([[3e38, 0, 0], [1e20, 0, 0], [-1e20, 0, 0], [0, 0, 0]], np.float32)
    found = thinned(far, 0.1)
    np.testing.assert_allclose(found, [[-1e20, 0, 0], [0, 0, 0], [1.5e38, 0, 0]], rtol=1e-6)
