# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A robot drives through a hall: the rings of its beams on the ceiling travel along with it."""

import numpy as np
import pytest
from hall import SENSOR_HEIGHT_M, hall

from mnsf_ros.core.reason import Verdict
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

SIZE = (30.0, 12.0, 4.0)
STEP_M = 0.12
NUM_SWEEPS = 8


def drive(view, person=None):
    """Yields the estimates of a drive, the points of their sweeps, and those on the person."""
    estimator = ObjectFlowEstimator(preset("online"))
    sweeps, masks = [], []
    for index in range(NUM_SWEEPS):
        place = None if person is None else np.add(person, (0.0, STEP_M * index))
        xyz, are_person = hall((STEP_M * index - 9.0, 0.0), SIZE, *view, seed=index, person=place)
        sweeps.append(Sweep(xyz, (index + 1) * 100_000_000, "lidar"))
        masks.append(are_person)
        if index > 1:
            yield estimator.estimate(SweepTriplet(*sweeps[-3:])), sweeps[-2].xyz, masks[-2]


@pytest.mark.parametrize("view", [(16, 15.0), (32, 25.0), (64, 22.0)])
def test_only_the_person_moves(view):
    dynamic = [
        (result.over_ground.dynamic, are_person)
        for result, _, are_person in drive(view, person=(-2.0, -2.0))
    ]
    assert not any((mask & ~are_person).any() for mask, are_person in dynamic)
    assert np.mean([mask[are_person].mean() for mask, are_person in dynamic[2:]]) > 0.9


def test_the_ceiling_is_named():
    *_, (result, xyz, _) = drive((32, 25.0))
    rows = np.flatnonzero((xyz[:, 2] + SENSOR_HEIGHT_M > SIZE[2] - 0.05) & (xyz[:, 0] > 8))
    assert result.reason_of(rows).verdict is Verdict.CEILING
    assert not result.kept[rows].any()
