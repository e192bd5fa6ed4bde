# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Surfaces of a map against plain answers, and clouds that are compared with them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from box_street import BoxStreet, pose
from scipy.spatial.transform import Rotation

from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.surface_map import SurfaceMap
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

SETTINGS = EgoMotionSettings()
REACH_M = 0.3


def points_of(normals, number=400, seed=0):
    """Points in one cell, around its middle, spread by so much along the axes."""
    spread = np.random.default_rng(seed).normal(0, normals, (number, 3))
    return np.clip(spread, -0.45, 0.45).astype(np.float32)


def map_of(*sweeps, cell_m=1.0, num_sweeps=30):
    surfaces = SurfaceMap(cell_m, num_sweeps)
    for points in sweeps:
        surfaces.add(points, np.eye(4))
    return surfaces


def squared_m2(surfaces, place):
    """Of one place, by how much it pulls: the curvature by a shift is the matrix of weights."""
    there = surfaces.compared(np.array([place], np.float32), np.eye(4), 100.0)
    return there.curvature[:3, :3]


class TestSurfaces:
    @pytest.mark.parametrize(
        ("spread", "expected"),
        [
            ((0.2, 0.2, 0.001), (0, 0, 1)),
            ((0.001, 0.2, 0.2), (1, 0, 0)),
            ((0.001, 0.001, 0.2), (1, 1, 0)),
            # What lies flat on a line may be the trace of one laser.
            ((0.2, 0.001, 0.001), (0, 0.5, 0.5)),
            ((0.28, 0.28, 0.28), (0, 0, 0)),
        ],
        ids=["ground", "wall", "pole", "trace", "bush"],
    )
    def test_count_across_what_is_flat(self, spread, expected):
        weights = squared_m2(map_of(points_of(spread)), (0, 0, 0))
        if expected == (0, 0.5, 0.5):
            assert np.trace(weights) == pytest.approx(1, abs=0.05)
            assert weights[0, 0] < 0.05
        else:
            np.testing.assert_allclose(weights, np.diag(expected), atol=0.05)

    def test_are_those_of_the_eigenvectors(self):
        turn = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()
        points = (points_of((0.03, 0.12, 0.2), 80) @ turn.T).astype(np.float32)
        variances, axes = np.linalg.eigh(np.cov(points.T.astype(np.float64), bias=True))
        weights = np.maximum(9e-4 / (variances + 9e-4) - 9e-4 / (1 / 12 + 9e-4), 0)
        weights[1] *= axes[2, 2] ** 2
        expected = axes @ np.diag(weights) @ axes.T
        found = squared_m2(map_of(points), points.mean(axis=0))
        np.testing.assert_allclose(found, expected, atol=2e-5)

    @pytest.mark.parametrize("number", [0, 1, 3])
    def test_need_four_points(self, number):
        points = points_of((0.2, 0.2, 0.001), 4)
        few, enough = map_of(points[:number]), map_of(points)
        there = few.compared(points, np.eye(4), REACH_M)
        assert there.num_on_surfaces == 0
        assert there.num_explained == (4 if number else 0)
        assert enough.compared(points, np.eye(4), REACH_M).num_on_surfaces == 4

    def test_follow_what_has_changed(self):
        low = points_of((0.2, 0.2, 0.001), 1000) - np.float32(0.2)
        high = points_of((0.2, 0.2, 0.001), 1000) + np.float32(0.2)
        changed = map_of(low, high)
        there = changed.compared(high[:1], np.eye(4), 1.0)
        assert abs(there.gradient[2]) < 0.01


class TestComparison:
    STREET = BoxStreet(2)

    def clouds(self):
        return [
            Cloud.of(self.STREET.sweep(pose(), index), None, SETTINGS).points for index in (0, 1)
        ]

    def test_is_what_one_equation_for_each_point_gives(self):
        points = points_of((0.03, 0.12, 0.2), 50)
        surfaces, sensor = map_of(points), pose(-0.02, 0.03, 0.01, yaw_deg=3)
        there = surfaces.compared(points, sensor, 1e4)
        weights = squared_m2(surfaces, (0, 0, 0))
        center = points.mean(axis=0, dtype=np.float64)
        moved = points @ sensor[:3, :3].T + sensor[:3, 3]
        gradient, curvature = np.zeros(6), np.zeros((6, 6))
        for place in moved:
            x, y, z = place - sensor[:3, 3]
            change = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
            gradient += change.T @ weights @ (place - center)
            curvature += change.T @ weights @ change
        assert there.num_on_surfaces == 50
        np.testing.assert_allclose(there.gradient, gradient, atol=1e-5)
        np.testing.assert_allclose(there.curvature, curvature, atol=1e-5)

    def test_what_is_too_far_off_does_not_count(self):
        surfaces = map_of(points_of((0.2, 0.2, 0.001)))
        places = np.array([[0, 0, 0.0], [0, 0, 0.1], [0, 0, 0.29], [0, 0, 0.31]], np.float32)
        pulls = [surfaces.compared(places[row : row + 1], np.eye(4), REACH_M) for row in range(4)]
        assert [each.num_on_surfaces for each in pulls] == [1, 1, 1, 0]
        assert [each.num_explained for each in pulls] == [1, 1, 1, 0]
        expected = [0, 0.1 * (1 - 1 / 9) ** 2, 0.29 * (1 - (0.29 / 0.3) ** 2) ** 2, 0]
        np.testing.assert_allclose([each.gradient[2] for each in pulls], expected, atol=1e-3)

    @pytest.mark.parametrize("number", [0, 1])
    def test_of_few_points(self, number):
        first, second = self.clouds()
        there = map_of(first).compared(second[:number], np.eye(4), REACH_M)
        assert there.num_on_surfaces <= number
        assert np.isfinite(there.curvature).all()

    def test_of_an_empty_map(self):
        there = SurfaceMap(1.0, 30).compared(self.clouds()[0], np.eye(4), REACH_M)
        assert (there.num_on_surfaces, there.num_explained) == (0, 0)
        assert not there.gradient.any()

    @pytest.mark.parametrize("far_m", [1e8, 1e20, 1e300, np.nan])
    def test_far_from_the_map_nothing_is_known(self, far_m):
        first, second = self.clouds()
        surfaces = map_of(first)
        before = surfaces.compared(second, np.eye(4), REACH_M)
        away = pose(0.0, far_m)
        assert surfaces.compared(second, away, REACH_M).num_explained == 0
        surfaces.add(second, away)
        after = surfaces.compared(second, np.eye(4), REACH_M)
        assert after.num_on_surfaces == before.num_on_surfaces

    def test_a_map_that_starts_far_away_is_as_good(self):
        first, second = self.clouds()
        here, there = SurfaceMap(1.0, 30), SurfaceMap(1.0, 30)
        here.add(first, np.eye(4))
        there.add(first, pose(1e7, -1e7))
        near = here.compared(second, pose(0.1), REACH_M)
        far = there.compared(second, pose(1e7 + 0.1, -1e7), REACH_M)
        assert near.num_on_surfaces == far.num_on_surfaces
        np.testing.assert_allclose(near.gradient, far.gradient, rtol=1e-5, atol=1e-5)

    def test_in_threads_side_by_side(self):
        first, second = self.clouds()
        surfaces = map_of(first)
        expected = surfaces.compared(second, np.eye(4), REACH_M)
        with ThreadPoolExecutor(4) as threads:
            found = list(
                threads.map(lambda _: map_of(first).compared(second, np.eye(4), REACH_M), range(8))
            )
        for each in found:
            np.testing.assert_array_equal(each.curvature, expected.curvature)


class TestForgetting:
    def test_cells_that_were_not_seen_for_long_are_dropped(self):
        old, new = points_of((0.2, 0.2, 0.001)), points_of((0.2, 0.2, 0.001)) + np.float32(10)
        short = map_of(old, *[new] * 19, num_sweeps=5)
        long = map_of(old, *[new] * 19, num_sweeps=30)
        for surfaces, number in ((short, 0), (long, 400)):
            assert surfaces.compared(old, np.eye(4), REACH_M).num_explained == number
            assert surfaces.compared(new, np.eye(4), REACH_M).num_explained == 400

    def test_room_grows_with_the_points(self):
        many = np.random.default_rng(0).uniform(-200, 200, (30_000, 3)).astype(np.float32)
        surfaces = map_of(many[:100], many, many)
        assert surfaces.compared(many, np.eye(4), REACH_M).num_explained == 30_000


class TestCloud:
    def plain(self, xyz):
        """Points in range, and whether they are near the lowest of their column of 1 m."""
        with np.errstate(over="ignore"):
            near = (xyz[:, 0] ** 2 + xyz[:, 1] ** 2 < 6400) & (np.abs(xyz[:, 2]) < 80)
        near = xyz[near]
        columns = [tuple(column) for column in (near[:, :2] + np.float32(80)).astype(int)]
        lowest = {}
        for column, z in zip(columns, near[:, 2], strict=True):
            lowest[column] = min(z, lowest.get(column, np.inf))
        low = [
            z < lowest[column] + np.float32(0.3)
            for column, z in zip(columns, near[:, 2], strict=True)
        ]
        return near, np.array(low, bool)

    def test_knows_what_is_near_the_ground(self):
        rng = np.random.default_rng(0)
        xyz = (rng.normal(0, 1, (4000, 3)) * (40, 40, 1)).astype(np.float32)
        near, low = self.plain(xyz)
        fine = Cloud.of(Sweep(xyz), None, EgoMotionSettings(thinning_m=0.05))
        # So fine that each point is in a cell of its own, in both sizes.
        assert fine.num_standing == len(fine.standing) == pytest.approx((~low).sum(), abs=8)
        assert len(fine) == pytest.approx(len(near), abs=8)

    @pytest.mark.parametrize("number", [0, 1])
    def test_of_few_points(self, number):
        cloud = Cloud.of(Sweep(np.ones((number, 3), np.float32)), None, SETTINGS)
        assert len(cloud) == number
        assert cloud.num_standing == 0

    def test_leaves_out_what_is_far(self):
        far = [[1e20, 0, 0], [0, -3e38, 0], [0, 0, 1e20], [80, 0, 0], [60, 60, 0], [1, 1, 1]]
        cloud = Cloud.of(Sweep(np.array(far, np.float32)), None, SETTINGS)
        np.testing.assert_array_equal(cloud.points, [[1, 1, 1]])

    def test_many_points_in_one_column(self):
        xyz = np.zeros((20_000, 3), np.float32)
        xyz[:, 2] = np.linspace(0, 20, 20_000)
        cloud = Cloud.of(Sweep(xyz), None, SETTINGS)
        assert cloud.standing[:, 2].min() >= 0.3
        assert len(cloud) == pytest.approx(20 / 0.3, abs=3)

    def test_of_a_sweep_that_must_not_be_written_to(self):
        xyz = np.ones((10, 3), np.float32)
        xyz.flags.writeable = False
        assert len(Cloud.of(Sweep(xyz), None, SETTINGS)) == 1
