# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid motions: their flow, and fits that find them again."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow, rigid_flow
from mnsf_ros.geometry.transforms import invert


def make_motion(seed=0, max_angle=0.1, max_way=2.0):
    rng = np.random.default_rng(seed)
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(rng.uniform(-max_angle, max_angle, 3)).as_matrix()
    motion[:3, 3] = rng.uniform(-max_way, max_way, 3)
    return motion


def make_points(num_points=2000, seed=0):
    """A street seen by a lidar: long, less wide, flat."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(num_points, 3)) * [20, 10, 1.5]


def exact_flow(xyz, motion):
    return xyz @ motion[:3, :3].T + motion[:3, 3] - xyz


def assert_close(found, motion, *, way=1e-6, turn=1e-7):
    np.testing.assert_allclose(found[:3, 3], motion[:3, 3], atol=way)
    np.testing.assert_allclose(found[:3, :3], motion[:3, :3], atol=turn)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found @ invert(found), np.eye(4), atol=1e-9)


def test_flow_of_a_quarter_turn_by_hand():
    motion = np.eye(4)
    motion[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    flow = rigid_flow(np.array([[2.0, 0, 5], [0, 3, 0]]), motion)
    assert flow.dtype == np.float32
    np.testing.assert_array_equal(flow, [[-2, 2, 0], [-3, -3, 0]])


def test_flow_far_from_the_origin_keeps_its_digits():
    motion = make_motion(max_angle=1e-7)
    xyz = make_points(100) + np.array([1e6, -2e6, 0])
    np.testing.assert_allclose(rigid_flow(xyz, motion), exact_flow(xyz, motion), atol=1e-6)
    xyz32 = xyz.astype(np.float32)
    expected = exact_flow(xyz32.astype(np.float64), motion)
    np.testing.assert_allclose(rigid_flow(xyz32, motion), expected, atol=1e-6)


def test_residual_is_the_motion_of_movers():
    motion, xyz = make_motion(), make_points(100)
    own = np.zeros((100, 3))
    own[40:60] = [1.0, -0.5, 0.0]
    residual = residual_flow(xyz, exact_flow(xyz, motion) + own, motion)
    assert residual.dtype == np.float32
    np.testing.assert_allclose(residual, own, atol=1e-5)
    xyz[1, 0], xyz[3, 2] = np.nan, np.inf
    for rows in (rigid_flow(xyz, motion), residual_flow(xyz, own, motion)):
        assert np.flatnonzero(~np.isfinite(rows).all(axis=1)).tolist() == [1, 3]


@pytest.mark.parametrize(
    ("seed", "max_angle", "max_way", "offset"),
    [(0, 0.1, 2.0, 0.0), (1, 0.1, 2.0, 0.0), (3, 2.0, 30.0, 0.0), (4, 0.1, 2.0, 1e3)],
)
def test_exact_motion_is_found(seed, max_angle, max_way, offset):
    motion, xyz = (
        make_motion(seed, max_angle, max_way),
        make_points(seed=seed) + np.array([offset, 0, 0]),
    )
    flow = exact_flow(xyz, motion)
    xyz.flags.writeable = flow.flags.writeable = False
    assert_close(fit_rigid_motion(xyz, flow), motion, way=1e-6 + 1e-9 * offset)
    ground = xyz * [1, 1, 0] - [0, 0, 1.7]
    assert_close(fit_rigid_motion(ground, exact_flow(ground, motion)), motion, way=1e-5)


@pytest.mark.parametrize("share", [0.1, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_movers_that_all_go_the_same_way_do_not_pull(share, seed):
    rng = np.random.default_rng(100 + seed)  # not that of the points: noise must not follow them
    motion, xyz = make_motion(seed), make_points(3000, seed)
    flow = exact_flow(xyz, motion)
    # A whole side of the street moves: worse for the rotation than movers all over.
    movers = np.argsort(xyz[:, 1])[: round(share * len(xyz))]
    flow[movers] += rng.uniform(0.3, 3.0) * np.array([1.0, 0.2, 0.0])
    assert_close(fit_rigid_motion(xyz, flow), motion)
    noisy = flow + rng.normal(scale=0.03, size=flow.shape)
    assert_close(fit_rigid_motion(xyz, noisy), motion, way=5e-3, turn=3e-4)


def test_outliers_and_rows_that_are_not_finite_are_left_out():
    motion, xyz = make_motion(), make_points()
    flow = exact_flow(xyz, motion)
    xyz[:3], flow[:3] = [[1e6, 1e6, 0], [0, -1e30, 0], [0, 3e38, 3e38]], 0.0
    xyz[5, 1], xyz[6, 0], flow[7, 2], flow[8] = np.nan, 1e200, -np.inf, np.nan
    assert_close(fit_rigid_motion(xyz, flow), motion)


LINE = np.linspace(0, 10, 50)[:, None] * [1.0, 2, 0.5] + [3, 0, 0]


@pytest.mark.parametrize("xyz", [LINE, LINE[:1], LINE[:2], np.full((10, 3), 4.0)])
def test_without_a_rotation_to_find_it_is_a_translation(xyz):
    found = fit_rigid_motion(xyz, np.full_like(xyz, 0.5))
    np.testing.assert_allclose(found[:3, 3], 0.5, atol=1e-12)
    np.testing.assert_allclose(found[:3, :3], np.eye(3), atol=1e-12)
    # A mirror is no rotation either.
    mirror = fit_rigid_motion(make_points(), make_points() * [0, 0, -2])
    assert np.linalg.det(mirror[:3, :3]) == pytest.approx(1.0)


def test_without_points_it_is_the_identity_and_results_repeat():
    nothing = np.full((4, 3), np.nan, np.float32)
    np.testing.assert_array_equal(fit_rigid_motion(nothing, nothing), np.eye(4))
    xyz = make_points(30_000)  # of which a random part is taken
    flow = exact_flow(xyz, make_motion()) + 0.01 * np.sin(xyz)
    np.testing.assert_array_equal(fit_rigid_motion(xyz, flow), fit_rigid_motion(xyz, flow))
