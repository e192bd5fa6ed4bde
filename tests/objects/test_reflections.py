# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Windows are seen where they face the sensor: what they show goes along with it."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface

from mnsf_ros.objects.reflections import reflections

SENSOR = np.array([0.8, 0.0, 0.0])
PANE = {"center": (1.0, 12.0, 0.5), "size": (3.0, 0.05, 1.5)}


def reflects(motion, sensor=SENSOR, *, center, size):
    objects = objects_of(prepared(surface(center, size=size)))
    return reflections(objects, rows(motion), sensor).tolist()


def test_a_pane_beside_the_sensor_that_goes_as_fast_is_one():
    assert reflects((0.8, 0.0, 0.0), **PANE) == [2]
    assert reflects((0.85, 0.01, 0.02), **PANE) == [2]


def test_a_narrow_pane_is_one():
    assert reflects((0.8, 0.0, 0.0), **{**PANE, "size": (0.4, 0.05, 1.5)}) == [2]


def test_a_row_of_panes_is_one_though_it_goes_more_slowly():
    assert reflects((0.45, 0.0, 0.0), **PANE) == [2]
    assert reflects((-0.45, 0.0, 0.0), **PANE) == [0]
    assert reflects((0.45, 0.0, 0.0), **{**PANE, "size": (1.5, 0.05, 1.5)}) == [0]


def test_a_long_flat_side_beside_the_sensor_is_one_in_part_only():
    lorry = {"center": (1.0, 3.0, 0.5), "size": (9.0, 0.05, 2.5)}
    assert reflects((0.8, 0.0, 0.0), **lorry) == [1]


@pytest.mark.parametrize(
    ("change", "motion", "sensor"),
    [
        ({}, (0.2, 0.0, 0.0), SENSOR),
        ({}, (0.0, 0.8, 0.0), SENSOR),
        ({}, (0.0, 0.0, 0.0), np.zeros(3)),
        ({"size": (3.0, 1.7, 1.5)}, (0.8, 0.0, 0.0), SENSOR),
        ({"size": (0.4, 0.18, 1.7)}, (0.14, 0.0, 0.0), SENSOR * 0.2),
        ({"center": (9.0, 12.0, 0.5)}, (0.8, 0.0, 0.0), SENSOR),
        ({"center": (12.0, 1.0, 0.5), "size": (0.05, 1.8, 1.5)}, (0.8, 0.0, 0.0), SENSOR),
    ],
    ids=[
        "slower",
        "away",
        "standing sensor",
        "car",
        "pedestrian",
        "far ahead",
        "rear of a car ahead",
    ],
)
def test_what_moves_otherwise_or_looks_otherwise_is_none(change, motion, sensor):
    assert reflects(motion, sensor, **{**PANE, **change}) == [0]


def test_none_at_all():
    objects = objects_of(prepared(surface((10.0, 0.0, 0.0)))).only(np.zeros(1, bool))
    assert reflections(objects, rows(), SENSOR).tolist() == []
