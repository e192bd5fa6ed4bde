# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from slow_geometry import signed_distance

from mnsf_ros.simulation.bodies import ShapeKind, entry_ranges

HALF = {
    ShapeKind.BOX: np.array([2.0, 1.0, 0.5]),
    ShapeKind.CYLINDER: np.array([0.7, 0.7, 1.5]),
    ShapeKind.SPHERE: np.array([1.2, 1.2, 1.2]),
}


def ranges_along(kind, origin, direction):
    components = tuple(np.array([value], dtype=float) for value in direction)
    return entry_ranges(kind, HALF[kind], np.array(origin, dtype=float), components)[0]


@pytest.mark.parametrize(
    ("kind", "origin", "direction", "expected"),
    [
        (ShapeKind.BOX, (-10, 0, 0), (1, 0, 0), 8.0),
        (ShapeKind.BOX, (0, 7, 0.2), (0, -1, 0), 6.0),
        (ShapeKind.BOX, (0, 0, 3), (0, 0, -1), 2.5),
        (ShapeKind.CYLINDER, (0, -4.7, 1), (0, 1, 0), 4.0),
        (ShapeKind.CYLINDER, (0.3, 0.3, 5), (0, 0, -1), 3.5),
        (ShapeKind.SPHERE, (4.2, 0, 0), (-1, 0, 0), 3.0),
    ],
)
def test_known_range(kind, origin, direction, expected):
    assert ranges_along(kind, origin, direction) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("kind", list(ShapeKind))
@pytest.mark.parametrize(
    ("origin", "direction"),
    [((-10, 0, 0), (-1, 0, 0)), ((-10, 5, 0), (1, 0, 0)), ((0, 0, 0), (0, 1, 0))],
    ids=["behind", "beside", "inside"],
)
def test_miss(kind, origin, direction):
    assert ranges_along(kind, origin, direction) == np.inf


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
