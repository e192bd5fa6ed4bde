# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Selection, bounds and thinning of points, against plain answers."""

import numpy as np
import pytest

from mnsf_ros.geometry.point_sets import bounds, chosen_points, thinned


def points(number, num_columns=3):
    return np.random.default_rng(0).normal(0, 8, (number, num_columns)).astype(np.float32)


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


def plain(rows, cell_m):
    cells = {}
    for row in rows.astype(np.float64):
        cells.setdefault(tuple(np.floor(row[2::-1] * (1 / cell_m))), []).append(row)
    means = [np.sum(own, axis=0) / len(own) for _, own in sorted(cells.items())]
    return np.array(means).reshape(-1, rows.shape[1]).astype(np.float32)


@pytest.mark.parametrize("cell_m", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("number", [0, 1, 3000])
@pytest.mark.parametrize("num_columns", [3, 5])
def test_means_come_in_the_order_of_the_cells(number, num_columns, cell_m):
    rows = points(number, num_columns)
    np.testing.assert_allclose(thinned(rows, cell_m), plain(rows, cell_m), rtol=1e-6)
    np.testing.assert_array_equal(thinned(rows[::2], cell_m), thinned(rows[::2].copy(), cell_m))


def test_far_places_are_in_the_outermost_cells():
    far = np.array([[3e38, 0, 0], [1e20, 0, 0], [-1e20, 0, 0], [0, 0, 0]], np.float32)
    found = thinned(far, 0.1)
    np.testing.assert_allclose(found, [[-1e20, 0, 0], [0, 0, 0], [1.5e38, 0, 0]], rtol=1e-6)
