# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from mnsf_ros.evaluation.argoverse_metrics import bucket_sums, over_all_points, three_way_sums

ROAD, CAR, PERSON, CYCLIST = 1, 6, 7, 8
LARGE, CONE, ANIMAL = 10, 11, 12


def array(*values):
    return np.array(values, dtype=np.float64)


def classes(*values):
    return np.array(values, dtype=np.uint8)


def test_three_way_groups_by_class_and_motion():
    errors = array(0.1, 0.3, 0.5, 0.02, 0.04, 9.0)
    dynamic = np.array([True, True, False, False, False, True])
    # The last point is background that moves: it is in none of the groups.
    sums = three_way_sums(errors, dynamic, classes(CAR, PERSON, CYCLIST, ROAD, 0, 3))
    assert sums == {
        "foreground dynamic": [2.0, pytest.approx(0.4), 0.0],
        "foreground static": [1.0, 0.5, 0.0],
        "background static": [2.0, pytest.approx(0.06), 0.0],
    }
    assert over_all_points([sums]) == {
        "three_way.foreground dynamic": pytest.approx(0.2),
        "three_way.foreground static": 0.5,
        "three_way.background static": pytest.approx(0.03),
        "three_way.mean": pytest.approx(0.73 / 3),
    }
    # Groups without points have no EPE, and then there is no mean of the three.
    epe_m = over_all_points([three_way_sums(array(0.2), np.array([False]), classes(ROAD))])
    assert epe_m["three_way.background static"] == 0.2
    assert math.isnan(epe_m["three_way.foreground dynamic"])
    assert math.isnan(epe_m["three_way.mean"])


def test_buckets_are_4_cm_wide_and_a_limit_belongs_to_the_bucket_above():
    motion = array(0.0, 0.0399, 0.04, 0.0799, 0.08, 1.9999, 2.0, 5.0)
    sums = bucket_sums(np.ones(8), motion, np.zeros((8, 2)), np.full(8, CAR, np.uint8))
    assert {name: values[0] for name, values in sums.items()} == {
        "CAR/0": 2,
        "CAR/1": 2,
        "CAR/2": 1,
        "CAR/49": 1,
        "CAR/50": 2,
    }


def test_only_points_within_a_square_of_35_m_count():
    """A corner is 49 m away and counts, too: the challenge has max(|x|, |y|) < 35."""
    xy = np.array([(0, 0), (34.999, -34.999), (35.0, 0), (0, -35.0), (20, 35.1)], np.float64)
    sums = bucket_sums(np.ones(5), np.zeros(5), xy, np.full(5, CAR, np.uint8))
    assert sums == {"CAR/0": [2.0, 2.0, 0.0]}


def test_classes_of_the_challenge():
    numbers = classes(0, ROAD, 9, CAR, PERSON, CYCLIST, LARGE, CONE, ANIMAL)
    buckets = bucket_sums(np.ones(9), np.zeros(9), np.zeros((9, 2)), numbers)
    assert {name: values[0] for name, values in buckets.items()} == {
        "BACKGROUND/0": 3,
        "CAR/0": 1,
        "PEDESTRIAN/0": 1,
        "WHEELED_VRU/0": 1,
        "OTHER_VEHICLES/0": 1,
    }
    # Everything labelled is foreground.
    groups = three_way_sums(np.ones(9), np.zeros(9, bool), numbers)
    assert {name: values[0] for name, values in groups.items()} == {
        "foreground static": 6,
        "background static": 3,
    }


def test_dynamic_error_is_the_mean_over_buckets_of_error_over_motion():
    # Bucket 2 (0.08 to 0.12): errors 0.02 and 0.04, motion 0.1 and 0.1: 0.03 / 0.1 = 0.3.
    # Bucket 25 (1.00 to 1.04): error 0.51, motion 1.02: 0.5. Mean 0.4; static 0.01.
    errors = array(0.02, 0.04, 0.51, 0.01)
    motion = array(0.1, 0.1, 1.02, 0.0)
    sums = bucket_sums(errors, motion, np.zeros((4, 2)), np.full(4, CAR, np.uint8))
    errors = over_all_points([sums])
    assert errors["bucketed.CAR.dynamic"] == errors["bucketed.mean.dynamic"] == pytest.approx(0.4)
    assert errors["bucketed.CAR.static"] == pytest.approx(0.01)
