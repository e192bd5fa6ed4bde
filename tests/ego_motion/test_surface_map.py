# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Surfaces of a map against plain answers."""

import numpy as np
import pytest
from box_street import pose
from scipy.spatial.transform import Rotation

from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.surface_map import SurfaceMap
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

SETTINGS = EgoMotionSettings()
NOISE_M = 0.05


def points_of(normals, number=400, seed=0):
    """Points in one cell, around its middle, spread by so much along the axes."""
    spread = np.random.default_rng(seed).normal(0, normals, (number, 3))
    return np.clip(spread, -0.45, 0.45).astype(np.float32)


def cloud_of(points, beam_axis=(0.0, 0.0, 1.0)):
    parts = np.zeros(len(points), np.int32), np.zeros(1)
    return Cloud(points, len(points), *parts, np.array(beam_axis))


def map_of(*sweeps, cell_m=1.0, num_sweeps=30, **axis):
    surfaces = SurfaceMap(cell_m, num_sweeps)
    for points in sweeps:
        surfaces.add(cloud_of(points, **axis), np.eye(4)[None])
    return surfaces


def compared(surfaces, points, sensor, noise_m=NOISE_M):
    return surfaces.compared(cloud_of(points), sensor[None], noise_m)


def squared_m2(surfaces, place):
    """Of one place, by how much it pulls: the curvature by a shift is the matrix of weights."""
    there = compared(surfaces, np.array([place], np.float32), np.eye(4), 100.0)
    return there.curvature[:3, :3]


class TestSurfaces:
    def test_are_those_of_the_eigenvectors(self):
        turn = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()
        points = (points_of((0.03, 0.12, 0.2), 80) @ turn.T).astype(np.float32)
        spread, ray = np.cov(points.T.astype(np.float64), bias=True), points.mean(axis=0)
        variances, axes = np.linalg.eigh(spread)
        weights = np.maximum(9e-4 / (variances + 9e-4) - 9e-4 / (1 / 12 + 9e-4), 0)
        weights[1] *= axes[2, 2] ** 2
        across = np.cross(ray, np.cross([0, 0, 1], ray))
        across /= np.linalg.norm(across)
        weights *= 1 - 9e-4 / (across @ spread @ across + 9e-4) * (axes.T @ across) ** 2
        expected = axes @ np.diag(weights) @ axes.T
        found = squared_m2(map_of(points), points.mean(axis=0))
        np.testing.assert_allclose(found, expected, atol=2e-5)

    @pytest.mark.parametrize(
        ("num_lasers", "is_held"), [(1, False), (8, True)], ids=["one laser", "several"]
    )
    def test_of_one_laser_do_not_hold_its_height(self, num_lasers, is_held):
        """On ground: its points lie in the plane of its rays, which pitches with the sensor."""
        angles, radii = np.mgrid[-0.1:0.1:20j, 3.75 : 4.25 : num_lasers * 1j]
        ground = np.full(angles.size, -1.8)
        ring = np.stack([*(radii * (np.cos(angles), np.sin(angles))).reshape(2, -1), ground], 1)
        pull = squared_m2(map_of(ring.astype(np.float32)), (4.0, 0.0, -1.8))[2, 2]
        assert (pull > 0.5) if is_held else (pull < 0.3)

    def test_of_one_laser_of_a_tilted_lidar_do_not_hold_the_direction_of_its_elevation(self):
        """A level frame of a lidar that looks down by 40 degrees; its ring on the ground beside."""
        level_from_lidar = Rotation.from_euler("y", 40, degrees=True)
        azimuths, elevation = np.radians(np.linspace(85, 95, 40)), np.radians(-20)
        flat = np.cos(elevation) * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        rays = level_from_lidar.apply(np.insert(flat, 2, np.sin(elevation), axis=1))
        ring = (-1.8 * rays / rays[:, 2:]).astype(np.float32)
        axis = level_from_lidar.apply([0.0, 0.0, 1.0])
        ray = ring.mean(axis=0)
        across = np.cross(ray, np.cross(axis, ray))
        across /= np.linalg.norm(across)
        pulls = [
            across @ squared_m2(map_of(ring, beam_axis=each), ray) @ across
            for each in (axis, np.array([0.0, 0.0, 1.0]))
        ]
        assert pulls[0] < 0.3
        assert pulls[1] > 0.4


class TestComparison:
    def test_is_what_one_equation_for_each_point_gives(self):
        points = points_of((0.03, 0.12, 0.2), 50)
        surfaces, sensor = map_of(points), pose(-0.02, 0.03, 0.01, yaw_deg=3)
        there = compared(surfaces, points, sensor, 1e4)
        weights = squared_m2(surfaces, (0, 0, 0))
        center = points.mean(axis=0, dtype=np.float64)
        moved = points @ sensor[:3, :3].T + sensor[:3, 3]
        gradient, curvature = np.zeros(6), np.zeros((6, 6))
        for place in moved:
            x, y, z = place - sensor[:3, 3]
            change = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
            gradient += change.T @ weights @ (place - center)
            curvature += change.T @ weights @ change
        assert there.support == pytest.approx(50)
        np.testing.assert_allclose(there.gradient, gradient, atol=1e-5)
        np.testing.assert_allclose(there.curvature, curvature, atol=1e-5)

    def test_its_gradient_is_that_of_the_support(self):
        points, step_m = points_of((0.2, 0.02, 0.2), 50), 1e-4
        surfaces = map_of(points)

        def at(x, y):
            return compared(surfaces, points, pose(x, y))

        found = at(0.01, 0.04).gradient[:2]
        along = at(0.01 + step_m, 0.04).support - at(0.01 - step_m, 0.04).support
        across = at(0.01, 0.04 + step_m).support - at(0.01, 0.04 - step_m).support
        expected = -(NOISE_M**2) / 2 * np.array([along, across]) / (2 * step_m)
        np.testing.assert_allclose(found, expected, rtol=0.01)

    def test_a_point_off_by_the_noise_counts_half(self):
        wall = points_of((0.2, 0.001, 0.2), 50)
        there = compared(map_of(wall), wall, pose(0, NOISE_M))
        assert there.support == pytest.approx(25, rel=0.1)
        assert there.num_known == 50


class TestForgetting:
    def test_cells_that_were_not_seen_for_long_are_dropped(self):
        old, new = points_of((0.2, 0.2, 0.001)), points_of((0.2, 0.2, 0.001)) + np.float32(10)
        short = map_of(old, *[new] * 19, num_sweeps=5)
        long = map_of(old, *[new] * 19, num_sweeps=30)
        for surfaces, number in ((short, 0), (long, 400)):
            assert compared(surfaces, old, np.eye(4)).num_known == number
            assert compared(surfaces, new, np.eye(4)).num_known == 400


class TestCloud:
    def test_of_a_sweep_that_must_not_be_written_to(self):
        xyz = np.ones((10, 3), np.float32)
        xyz.flags.writeable = False
        assert len(Cloud.of(Sweep(xyz), None, SETTINGS)) == 1
