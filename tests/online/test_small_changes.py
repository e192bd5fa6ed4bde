# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small changes of two sweeps that must not matter: time of day, interval, order of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_street import BoxStreet, pose

from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, SweepTriplet

SETTINGS = Settings().changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
# So few points that votes for wrong motions are close to those for the true ones.
POINTS_PER_BOX = 60
# First place, and metres from one sweep to the next.
CARS = np.array([[[-14, -3], [0.8, 0]], [[12, 1.5], [-1.5, 0.1]], [[3, -3], [2.4, -0.2]]])
STREET = BoxStreet()
SWEEPS = [
    STREET.sweep(
        pose(0.6 * index, yaw_deg=index),
        index,
        cars=CARS[:, 0] + index * CARS[:, 1],
        points_per_box=POINTS_PER_BOX,
    )
    for index in range(2)
]


def estimated(sweeps):
    """Flow (N, 3) and movers (N,)."""
    estimate = ObjectFlowEstimator(SETTINGS).estimate(SweepTriplet(None, *sweeps))
    return estimate.flow, estimate.over_ground.dynamic


def assert_same(found, expected):
    for array, same in zip(found, expected, strict=True):
        np.testing.assert_array_equal(array, same)


@pytest.fixture(scope="module")
def expected():
    flow, dynamic = estimated(SWEEPS)
    assert dynamic.any()
    return flow, dynamic


def test_hours_later(expected):
    hours_ns = 7 * 3600 * NANOSECONDS
    later = [replace(sweep, stamp_ns=sweep.stamp_ns + hours_ns) for sweep in SWEEPS]
    assert_same(estimated(later), expected)


@pytest.mark.parametrize("factor", [0.99, 1.001, 1.005, 1.01])
def test_another_interval(expected, factor):
    slower = [replace(sweep, stamp_ns=round(factor * sweep.stamp_ns)) for sweep in SWEEPS]
    assert_same(estimated(slower), expected)


def test_another_order_of_points(expected):
    rows = [np.random.default_rng(seed).permutation(len(each)) for seed, each in enumerate(SWEEPS)]
    shuffled = [sweep.part(order) for sweep, order in zip(SWEEPS, rows, strict=True)]
    assert_same(estimated(shuffled), [array[rows[0]] for array in expected])
