# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One point for each cell, against a plain answer."""

from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.geometry.thinning import thinned


def plain(xyz, cell_m):
    cells = {}
    for point in xyz:
        key = tuple(np.floor(point.astype(np.float64) * (1 / cell_m))[::-1])
        cells.setdefault(key, []).append(point.astype(np.float64))
    means = [np.sum(points, axis=0) / len(points) for _, points in sorted(cells.items())]
    return np.array(means).reshape(-1, 3).astype(np.float32)


@pytest.mark.parametrize("cell_m", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("number", [0, 1, 2, 3000])
def test_means_come_in_the_order_of_the_cells(number, cell_m):
    xyz = np.random.default_rng(number).normal(0, 8, (number, 3)).astype(np.float32)
    np.testing.assert_allclose(thinned(xyz, cell_m), plain(xyz, cell_m), rtol=1e-6)


def test_many_points_in_one_cell():
    xyz = np.random.default_rng(0).uniform(0.01, 0.09, (50_000, 3)).astype(np.float32)
    np.testing.assert_allclose(thinned(xyz, 0.1), [xyz.mean(axis=0, dtype=np.float64)], rtol=1e-6)


def test_far_places_are_in_the_outermost_cells():
    far = np.array([[3e38, 0, 0], [1e20, 0, 0], [-1e20, 0, 0], [0, 0, 0]], np.float32)
    found = thinned(far, 0.1)
    np.testing.assert_allclose(found, [[-1e20, 0, 0], [0, 0, 0], [1.5e38, 0, 0]], rtol=1e-6)


def test_every_other_point_of_an_array_is_as_good_as_a_copy():
    xyz = np.random.default_rng(1).normal(0, 3, (400, 3)).astype(np.float32)
    np.testing.assert_array_equal(thinned(xyz[::2], 0.5), thinned(xyz[::2].copy(), 0.5))
