# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Nearest points by cells, against a tree of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from box_street import pose
from scipy.spatial import cKDTree

from mnsf_ros.geometry.point_grid import REACH_M, PointGrid

NOWHERE = np.zeros((1, 3), np.float32)


def cloud(number, size_m, center=(0, 0, 0), seed=0):
    """(number, 3) points in a box."""
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (number, 3)) * size_m
    return (points + center).astype(np.float32)


def compared(grid, positions, reach_m=0.5, within_m=0.0, motion=(0, 0, 0), transform=None):
    """Of each point on its own."""
    return grid.compared(
        positions,
        np.arange(len(positions)),
        np.tile(np.float32([motion]), (len(positions), 1)),
        np.eye(4) if transform is None else transform,
        np.full(len(positions), within_m, np.float32),
        np.full(len(positions), reach_m, np.float32),
    )


class TestPointGrid:
    @pytest.mark.parametrize("center", [(0, 0, 0), (-3, 7.3, 1), (900, -2000, 30)])
    @pytest.mark.parametrize("size_m", [0.5, 4.0, (60, 60, 3)])
    @pytest.mark.parametrize("reach_m", [0.05, REACH_M])
    def test_finds_the_nearest_point(self, center, size_m, reach_m):
        points, places = cloud(3000, size_m, center), cloud(500, size_m, center, seed=1)
        distances, vectors, counts = compared(PointGrid(points), places, reach_m)
        expected, nearest = cKDTree(points).query(places, distance_upper_bound=reach_m)
        has_one = np.isfinite(expected)
        assert counts.tolist() == has_one.tolist()
        np.testing.assert_allclose(distances, np.minimum(expected, reach_m), rtol=1e-5, atol=1e-6)
        led_to = places + vectors
        np.testing.assert_allclose(led_to[has_one], points[nearest[has_one]], atol=3e-4)
        assert not vectors[~has_one].any()

    @pytest.mark.parametrize(
        ("number", "center"), [(1, (0, 0, 0)), (300, (5, -2, 0)), (30_000, (-90, 4, 2))]
    )
    def test_nearest_rows_are_those_of_the_points_given(self, number, center):
        points, places = cloud(number, 4.0, center), cloud(500, 5.0, center, seed=1)
        rows_found = PointGrid(points).nearest(places, 0.5)
        _, expected = cKDTree(points).query(places, distance_upper_bound=0.5)
        assert rows_found.tolist() == np.where(expected == number, -1, expected).tolist()

    def test_sums_over_the_points_of_each_object(self):
        points, places = cloud(3000, 5.0), cloud(100, 6.0, seed=1)
        grid, owners = PointGrid(points), np.sort(np.arange(100) % 7)
        motions = cloud(7, 1.0, seed=2)
        exactly = np.zeros(100, np.float32)
        sums = grid.compared(places, owners, motions, np.eye(4), exactly)
        of_each = compared(grid, places + motions[owners])
        for found, each in zip(sums, of_each, strict=True):
            expected = np.zeros((7, *each.shape[1:]))
            np.add.at(expected, owners, each)
            np.testing.assert_allclose(found, expected, rtol=1e-6)

    def test_places_are_moved_and_then_seen_from_elsewhere(self):
        transform = pose(3, -1, 0.2, yaw_deg=25)
        points, places = cloud(3000, 5.0), cloud(100, 6.0, seed=1)
        motion = (0.3, -0.2, 0.1)
        found = compared(PointGrid(points), places, motion=motion, transform=transform)
        there = (places + motion) @ transform[:3, :3].T + transform[:3, 3]
        expected = compared(PointGrid(points), there.astype(np.float32))
        np.testing.assert_allclose(found[0], expected[0], atol=1e-5)
        np.testing.assert_allclose(found[1], expected[1], atol=1e-5)

    @pytest.mark.parametrize("far_m", [1e8, 3e9, 1e19, 3e38, np.inf, np.nan])
    def test_huge_coordinates_are_nowhere(self, far_m):
        far = np.float32([(far_m, 0, 0), (0, -far_m, 0), (-far_m, far_m, far_m), (0, 0, far_m)])
        with np.errstate(over="ignore", invalid="ignore"):
            near = PointGrid(np.concatenate([far, NOWHERE]))
            distances, _, counts = compared(near, np.concatenate([far + 1.0, NOWHERE]))
        assert counts[-1] == 1
        assert distances[-1] == 0
        assert np.isfinite(distances).all()
