# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rays of the simulated lidar, against slow and obvious geometry."""

import numpy as np
import pytest
from slow_geometry import signed_distance

from mnsf_ros.geometry.transforms import apply, invert, planar_pose, tilt
from mnsf_ros.simulation.bodies import Shape, ShapeKind, box, entry_ranges
from mnsf_ros.simulation.lidar import Rays, ShapeTable
from mnsf_ros.simulation.sensor import Sensor, knee_elevations_deg

FULL = (slice(None), slice(None))
LIMITS_M = (0.9, 100.0)
HALF = {
    ShapeKind.BOX: np.array([2.0, 1.0, 0.5]),
    ShapeKind.CYLINDER: np.array([0.7, 0.7, 1.5]),
    ShapeKind.SPHERE: np.array([1.2, 1.2, 1.2]),
}


@pytest.mark.parametrize("kind", list(ShapeKind))
def test_entry_is_the_first_point_on_the_surface(kind):
    rng = np.random.default_rng(3)
    origin = np.array([3.0, -2.5, 1.7])
    rays = rng.normal(size=(4000, 3)) - 0.4 * origin
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    entry = entry_ranges(kind, HALF[kind], origin, tuple(rays.T))
    hit = np.isfinite(entry)
    assert 50 < hit.sum() < 3950
    points = origin + entry[hit, None] * rays[hit]
    assert np.abs(signed_distance(kind, HALF[kind], points)).max() < 1e-9
    # Marching along each ray finds nothing before the entry, and nothing at all on a miss.
    for part in np.linspace(0.0, 0.999, 60):
        before = origin + part * entry[hit, None] * rays[hit]
        assert signed_distance(kind, HALF[kind], before).min() > 0
    for reach in np.linspace(0.0, 8.0, 160):
        assert signed_distance(kind, HALF[kind], origin + reach * rays[~hit]).min() > -0.01


def revolution(num_columns, num_beams, phase):
    """Rays of a whole turn of a usual lidar."""
    sensor = Sensor("", knee_elevations_deg(num_beams), num_columns, 10.0, 0.0, 0.0, 120.0)
    return next(sensor.rays(0, phase))[0]


def random_shape(rng):
    kind = ShapeKind(int(rng.integers(3)))
    half = rng.uniform(0.2, 3.0, 3)
    if kind != ShapeKind.BOX:
        half[1] = half[0]
    if kind == ShapeKind.SPHERE:
        half[2] = half[0]
    position = rng.uniform(-25, 25, 3) * (1, 1, 0.15)
    pose = planar_pose(*position[:2], rng.uniform(-3, 3), position[2]) @ tilt(
        *rng.normal(0, 0.1, 2)
    )
    return Shape(kind, tuple(half), pose)


def scattered(rng):
    """Rays as a rosette sends them, each with an elevation of its own."""
    azimuth = np.sort(rng.uniform(-1.2, 1.2, 4000))
    return Rays(azimuth, rng.uniform(-0.4, 0.2, (4000, 1)))


@pytest.mark.parametrize("kind", ["turn", "sector", "scattered"])
@pytest.mark.parametrize("seed", range(3))
def test_culling_changes_nothing(seed, kind):
    rng = np.random.default_rng(seed)
    # The last shapes stand around, above and below the lidar and behind it, across azimuth pi.
    shapes = [random_shape(rng) for _ in range(40)]
    shapes += [
        box((-9, 9), (3, 4), (-2, 8)),
        box((-1, 2), (-1, 1), (-3, -2)),
        box((-30, 30), (-30, 30), (4, 5)),
        box((-12, -10), (-3, 3), (-2, 2)),
    ]
    rays = {
        "turn": revolution(180, 32, rng.uniform()),
        # Across the azimuth pi.
        "sector": Rays(np.linspace(2.5, 4.1, 90), np.linspace(-0.4, 0.1, 24)[None]),
        "scattered": scattered(rng),
    }[kind]
    ranges, bodies = ShapeTable(shapes, list(range(len(shapes)))).cast(
        rays, np.broadcast_to(np.eye(4), (len(shapes), 4, 4)), LIMITS_M
    )
    expected = np.full(ranges.shape, np.inf)
    for shape in shapes:
        rotation = shape.body_from_shape[:3, :3].T
        origin = invert(shape.body_from_shape)[:3, 3]
        entry = entry_ranges(
            shape.kind, np.array(shape.half_extents), origin, rays.directions(rotation, FULL)
        )
        expected = np.minimum(expected, np.where(entry >= LIMITS_M[0], entry, np.inf))
    assert np.array_equal(np.isfinite(ranges), np.isfinite(expected))
    hit = np.isfinite(expected)
    assert np.allclose(ranges[hit], expected[hit], rtol=0, atol=1e-9)
    assert np.array_equal(bodies >= 0, hit)


def test_normals_are_how_the_distance_to_the_surface_grows():
    rng = np.random.default_rng(4)
    shapes = [random_shape(rng) for _ in range(30)]
    table = ShapeTable(shapes, list(range(len(shapes))))
    poses = np.broadcast_to(np.eye(4), (len(shapes), 4, 4))
    rays = revolution(180, 32, 0.3)
    ranges, hit = (array.ravel() for array in table.cast(rays, poses, LIMITS_M))
    met = np.flatnonzero(hit >= 0)
    directions = np.stack(rays.directions(np.eye(3), FULL), axis=-1).reshape(-1, 3)
    points, hit = directions[met] * ranges[met, None], hit[met]
    normals = table.normals(hit, points, poses)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert {shapes[number].kind for number in hit} == set(ShapeKind)
    for shape, number in ((shapes[number], number) for number in np.unique(hit)):
        own, inverse = hit == number, invert(shape.body_from_shape)
        outside = apply(inverse, points[own] + 0.01 * normals[own])
        distances = signed_distance(shape.kind, np.array(shape.half_extents), outside)
        assert distances == pytest.approx(0.01, abs=1e-6)
