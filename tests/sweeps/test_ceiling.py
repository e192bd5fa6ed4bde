# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The ceiling of halls and corridors, and what is none."""

import numpy as np
import pytest
from hall import SENSOR_HEIGHT_M, hall

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.ceiling import ceiling_mask

SETTINGS = Settings().ground


def found(xyz):
    """(N,) which points above the floor are on a ceiling."""
    xyz = np.asarray(xyz, np.float32)
    return ceiling_mask(xyz, xyz[:, 2] + SENSOR_HEIGHT_M > SETTINGS.margin_m, SETTINGS)


@pytest.mark.parametrize("view", [(16, 15.0), (32, 25.0), (64, 22.0), (128, 45.0)])
@pytest.mark.parametrize("size", [(30, 12, 2.6), (30, 12, 4.0), (60, 2, 2.6)])
def test_a_ceiling_is_found_and_nothing_below_it(view, size):
    person = np.array([4.0, 0.5])
    xyz, are_person = hall((0.0, 0.0), size, *view, person=person)
    height = xyz[:, 2] + SENSOR_HEIGHT_M
    is_near = np.hypot(xyz[:, 0], xyz[:, 1]) < 15
    are_on_it = (height > size[2] - 0.05) & is_near
    assert are_on_it.sum() > 100
    mask = found(xyz)
    assert mask[are_on_it].mean() > 0.98
    assert not mask[are_person | (height < size[2] - 0.3)].any()


def crowns(rng, number=12):
    """Points of crowns of trees beside a street, without their trunks."""
    middles = rng.uniform((-30, -12, 3.0), (30, 12, 4.0), (number, 3))
    directions = rng.normal(size=(number, 400, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    return (middles[:, None] + rng.uniform(1.0, 2.0, (number, 400, 1)) * directions).reshape(-1, 3)


def facades(rng):
    """Points of walls along a street, above a hedge that hides their lower part."""
    x, z = rng.uniform((-40, 0.4), (40, 4.0), (8000, 2)).T
    return np.stack([x, np.where(np.arange(len(x)) % 2, -8.0, 8.0), z], axis=1)


def roofs(rng):
    """Points of roofs of cars below the sensor, and of people beside them whose heads are above."""
    cars = rng.uniform((-30, -9, -0.35), (30, 9, -0.3), (6000, 3))
    heads = rng.uniform((-0.2, -0.2, -0.5), (0.2, 0.2, 0.8), (20, 100, 3))
    return np.vstack(
        [cars, (heads + rng.uniform((-9, -9, 0), (9, 9, 0), (20, 1, 3))).reshape(-1, 3)]
    )


@pytest.mark.parametrize("things", [crowns, facades, roofs])
def test_outdoors_there_is_none(things):
    assert not found(things(np.random.default_rng(0))).any()


def test_what_has_something_above_it_is_no_ceiling():
    rng = np.random.default_rng(0)
    tables = np.append(rng.uniform(-6, 6, (8000, 2)), np.full((8000, 1), 0.6), axis=1)
    person = rng.uniform((4.0, 0.0, -0.6), (4.5, 0.5, 1.0), (500, 3))
    mask = found(np.vstack([tables, person]))
    assert mask[:8000].mean() > 0.98
    assert not mask[8000:].any()


def test_without_points_there_is_none():
    assert found(np.zeros((0, 3))).shape == (0,)
