# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Errors of a flow: values worked out by hand, thresholds hit exactly, and the odd cases."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.metrics import (
    FlowErrors,
    angle_errors,
    by_motion,
    end_point_errors,
    flow_errors,
    mean_of,
    relative_errors,
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
    np.testing.assert_allclose(relative_errors(estimate, truth), [0.04, 0.075, 5, 0.05])
    angles = [math.atan(0.04), math.atan(0.075), math.atan(3 / 5), math.atan(0.4 / 10.3)]
    np.testing.assert_allclose(angle_errors(estimate, truth), angles)
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


def test_perfect_flow_has_the_smallest_angle_of_the_formula():
    errors = one((1, 2, 3), (1, 2, 3))
    assert errors == FlowErrors(0, 1, 1, 0, pytest.approx(SMALLEST_ANGLE), 1)


def test_opposite_flow():
    errors = one((-1, -2, 2), (1, 2, -2))
    assert errors.epe_m == 6
    assert errors.angle_error_rad == pytest.approx(math.pi - SMALLEST_ANGLE)


@pytest.mark.parametrize(
    ("estimate", "truth", "accurate", "outlier"),
    [
        ((0, 0, 0), (0, 0, 0), 1, 0),
        ((0, 0, 0), (1, 0, 0), 0, 1),
        ((0.001, 0, 0), (0, 0, 0), 1, 1),
    ],
)
def test_zero_vectors_are_a_right_angle_away(estimate, truth, accurate, outlier):
    errors = one(estimate, truth)
    assert errors.angle_error_rad == math.pi / 2
    assert (errors.acc5, errors.outliers) == (accurate, outlier)


def test_float32_is_scored_in_float64():
    truth = np.full((1000, 3), 100.0, np.float32)
    estimate = truth + np.float32(1e-4)
    exact = float(np.linalg.norm(estimate[0].astype(float) - truth[0].astype(float)))
    assert flow_errors(estimate, truth).epe_m == pytest.approx(exact, rel=1e-12)


def test_only_valid_points_are_scored():
    truth = np.array([[1, 0, 0], [np.nan] * 3, [1, 0, 0]])
    estimate = np.array([[1, 0, 0], [1, 0, 0], [np.nan] * 3])
    errors = flow_errors(estimate, truth, np.array([True, False, False]))
    assert (errors.epe_m, errors.num_points) == (0, 1)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["estimate", "truth"])
def test_flow_that_is_not_finite_is_refused_and_counted(name, bad):
    flows = {"estimate": np.ones((5, 3)), "truth": np.ones((5, 3))}
    flows[name][[1, 3], 2] = bad
    text = f"{name}: 2 of 5 points to score have no finite flow; leave them out with valid"
    with pytest.raises(EvaluationError, match=f"^{re.escape(text)}$"):
        flow_errors(flows["estimate"], flows["truth"])


def test_nothing_to_score_is_nan():
    flow = np.ones((3, 3))
    assert is_empty(flow_errors(flow, flow, np.zeros(3, bool)))
    assert is_empty(flow_errors(flow[:0], flow[:0]))
    assert all(map(is_empty, by_motion(flow, flow, np.ones(3, bool), np.zeros(3, bool)).values()))


def test_by_motion_splits_the_valid_points():
    truth = np.array([[1, 0, 0]] * 4, float)
    estimate = truth + np.array([[0, 0, 0], [0, 1, 0], [0, 0, 3], [0, 0, 50]])
    dynamic = np.array([False, False, True, True])
    errors = by_motion(estimate, truth, dynamic, np.array([True, True, True, False]))
    assert list(errors) == ["all", "dynamic", "static"]
    assert [errors[part].epe_m for part in errors] == pytest.approx([4 / 3, 3, 0.5])
    assert [errors[part].num_points for part in errors] == [3, 1, 2]
    everything = by_motion(estimate, truth, dynamic)
    assert [everything[part].num_points for part in everything] == [4, 2, 2]
    assert everything["all"] == flow_errors(estimate, truth)


def test_mean_counts_every_example_the_same():
    first = FlowErrors(0.1, 0.5, 0.6, 0.2, 0.3, 10)
    second = FlowErrors(0.3, 0.7, 1.0, 0.4, 0.1, 1000)
    empty = FlowErrors(math.nan, math.nan, math.nan, math.nan, math.nan, 0)
    mean = mean_of(iter([first, empty, second]))
    values = (mean.epe_m, mean.acc5, mean.acc10, mean.outliers, mean.angle_error_rad)
    assert values == pytest.approx((0.2, 0.6, 0.8, 0.3, 0.2))
    assert mean.num_points == 1010
    assert is_empty(mean_of([]))
    assert is_empty(mean_of([empty]))


@pytest.mark.parametrize(
    ("estimate", "truth", "valid", "text"),
    [
        ((4, 3), (5, 3), None, "estimate: got shape (4, 3), expected that of truth, (5, 3)"),
        ((4, 2), (4, 2), None, "truth: got shape (4, 2), expected (N, 3)"),
        ((3,), (3,), None, "truth: got shape (3,), expected (N, 3)"),
        ((4, 3), (4, 3), np.ones(3, bool), "valid: got shape (3,) of bool, expected (4,) bool"),
        ((2, 3), (2, 3), np.array([0, 1]), "valid: got shape (2,) of int64, expected (2,) bool"),
    ],
)
def test_what_does_not_fit_is_refused(estimate, truth, valid, text):
    with pytest.raises(EvaluationError, match=f"^{re.escape(text)}$"):
        flow_errors(np.ones(estimate), np.ones(truth), valid)
    flow = np.ones((4, 3))
    with pytest.raises(EvaluationError, match=r"^dynamic: got shape \(4,\) of float64, expected"):
        by_motion(flow, flow, np.ones(4))
