# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Errors of a flow: values worked out by hand, thresholds hit exactly, and the odd cases."""

import math

import numpy as np
import pytest

from mnsf_ros.evaluation.metrics import (
    FlowErrors,
    by_motion,
    end_point_errors,
    flow_errors,
)

SMALLEST_ANGLE = math.acos(1 - 1e-7)


def one(estimate, truth):
    """The errors of a single point."""
    return flow_errors(np.array([estimate], float), np.array([truth], float))


def is_empty(errors):
    values = (errors.epe_m, errors.acc5, errors.acc10, errors.outliers, errors.angle_error_rad)
    return errors.num_points == 0 and all(math.isnan(value) for value in values)


def test_four_points_by_hand():
    truth = np.array([[1, 0, 0], [0, 2, 0], [0, 0, 1], [10, 0, 0]], float)
    estimate = np.array([[1, 0.04, 0], [0, 2, 0.15], [0, 3, 5], [10.3, 0.4, 0]], float)
    # e: 0.04, 0.15, 5, 0.5 m; e / |truth|: 0.04, 0.075, 5, 0.05
    np.testing.assert_allclose(end_point_errors(estimate, truth), [0.04, 0.15, 5, 0.5])
    angles = [math.atan(0.04), math.atan(0.075), math.atan(3 / 5), math.atan(0.4 / 10.3)]
    errors = flow_errors(estimate, truth)
    assert errors.epe_m == pytest.approx(5.69 / 4)
    assert errors.acc5 == 0.25
    assert errors.acc10 == 0.75
    assert errors.outliers == 0.5
    assert errors.angle_error_rad == pytest.approx(sum(angles) / 4)
    assert errors.num_points == 4


@pytest.mark.parametrize(
    ("estimate", "truth", "acc5", "acc10", "outlier"),
    [
        # The distance alone decides: zero truth makes the relative error huge.
        ((0.05, 0, 0), (0, 0, 0), 0, 1, 1),
        ((np.nextafter(0.05, 0), 0, 0), (0, 0, 0), 1, 1, 1),
        ((0.1, 0, 0), (0, 0, 0), 0, 0, 1),
        ((np.nextafter(0.1, 0), 0, 0), (0, 0, 0), 0, 1, 1),
        # The relative error alone decides: the distances are metres.
        ((21, 0, 0), (20, 0, 0), 0, 1, 1),
        ((20.9999, 0, 0), (20, 0, 0), 1, 1, 1),
        ((11, 0, 0), (10, 0, 0), 0, 0, 1),
        ((10.9999, 0, 0), (10, 0, 0), 0, 1, 1),
        # An outlier by distance, or not: 0.3 m of 100 m.
        ((100, 0.3, 0), (100, 0, 0), 1, 1, 0),
        ((100, np.nextafter(0.3, 1), 0), (100, 0, 0), 1, 1, 1),
        # An outlier by relative error, or not: 0.125 m of 1.25 m is exactly a tenth.
        ((1.375, 0, 0), (1.25, 0, 0), 0, 0, 0),
        ((1.376, 0, 0), (1.25, 0, 0), 0, 0, 1),
    ],
)
def test_thresholds_are_strict(estimate, truth, acc5, acc10, outlier):
    errors = one(estimate, truth)
    assert (errors.acc5, errors.acc10, errors.outliers) == (acc5, acc10, outlier)


@pytest.mark.parametrize(
    ("estimate", "truth", "epe_m", "accurate", "outlier", "angle_rad"),
    [
        ((1, 2, 3), (1, 2, 3), 0, 1, 0, SMALLEST_ANGLE),
        ((-1, -2, 2), (1, 2, -2), 6, 0, 1, math.pi - SMALLEST_ANGLE),
        # Zero vectors are a right angle away.
        ((0, 0, 0), (0, 0, 0), 0, 1, 0, math.pi / 2),
        ((0, 0, 0), (1, 0, 0), 1, 0, 1, math.pi / 2),
        ((0.001, 0, 0), (0, 0, 0), 0.001, 1, 1, math.pi / 2),
    ],
)
def test_edges_of_the_formulas(estimate, truth, epe_m, accurate, outlier, angle_rad):
    errors = one(estimate, truth)
    expected = FlowErrors(epe_m, accurate, accurate, outlier, pytest.approx(angle_rad), 1)
    assert errors == expected


def test_float32_is_scored_in_float64():
    truth = np.full((1000, 3), 100.0, np.float32)
    estimate = truth + np.float32(1e-4)
    exact = float(np.linalg.norm(estimate[0].astype(float) - truth[0].astype(float)))
    assert flow_errors(estimate, truth).epe_m == pytest.approx(exact, rel=1e-12)


def test_dynamic_and_static_points_are_scored_apart():
    truth = np.array([[1, 0, 0]] * 4, float)
    estimate = truth + np.array([[0, 0, 0], [0, 1, 0], [0, 0, 3], [0, 0, 50]])
    dynamic = np.array([False, False, True, True])
    errors = by_motion(estimate, truth, dynamic)
    assert [(name, one.epe_m, one.num_points) for name, one in errors.items()] == [
        ("all", 13.5, 4),
        ("dynamic", 26.5, 2),
        ("static", 0.5, 2),
    ]
    assert errors["all"] == flow_errors(estimate, truth)
    # Nothing to score is NaN.
    assert is_empty(by_motion(estimate, truth, dynamic & False)["dynamic"])
