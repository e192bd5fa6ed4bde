# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online method on sweeps whose points have times: flow of the points as they came."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_sweeps import Turning

from mnsf_ros.core.reason import Verdict
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import SweepTriplet

STREET = SimulationSettings(seed=3, duration_s=1.0, num_beams=32, num_columns=1000)
SETTINGS = preset("online")
AS_THEY_CAME = SETTINGS.changed({"ego_motion.deskew": False})


def sweeps_of(number, **how):
    turning = Turning(SweepSimulator(STREET), **how)
    return [turning.sweep(index) for index in range(number)]


@pytest.fixture(scope="module")
def street():
    return sweeps_of(5)


def estimates(bent, settings=SETTINGS):
    estimator = make_method("online", settings)
    sweeps = [item.sweep for item in bent]
    return [
        estimator.estimate(SweepTriplet(*sweeps[first : first + 3]))
        for first in range(len(sweeps) - 2)
    ]


def test_flow_is_that_of_the_points_as_they_came(street):
    errors_m = {"static": [], "dynamic": []}
    for true, found in zip(street[1:], estimates(street), strict=False):
        of_points = end_point_errors(found.flow, true.flow)
        errors_m["static"].append(of_points[~true.dynamic].mean())
        errors_m["dynamic"].append(of_points[true.dynamic & ~true.ground].mean())
    assert np.mean(errors_m["static"]) < 0.02
    assert np.mean(errors_m["dynamic"]) < 0.2


def test_reason_has_the_residuals_of_points_with_times(street):
    true, found = street[1], estimates(street)[0]
    movers = np.flatnonzero(true.dynamic & found.over_ground.dynamic)
    reason = found.reason_of(movers)
    assert reason.verdict is Verdict.DYNAMIC
    for terms in reason.sweeps[:2]:
        assert terms.moving.residual_m < terms.static.residual_m


def test_without_times_nothing_changes(street):
    without = [replace(item, sweep=replace(item.sweep, times_s=None)) for item in street]
    for other in (estimates(street, AS_THEY_CAME), estimates(without, AS_THEY_CAME)):
        for one, two in zip(estimates(without), other, strict=True):
            np.testing.assert_array_equal(one.flow, two.flow)
            np.testing.assert_array_equal(one.over_ground.confidence, two.over_ground.confidence)


def test_objects_are_where_they_are_at_the_stamp(street):
    """A body is measured up to 0.1 s after the stamp; meanwhile it and the sensor move."""
    simulator = SweepSimulator(STREET)
    errors_m = []
    for index, (true, found) in enumerate(zip(street[1:], estimates(street), strict=False), 1):
        ids = found.over_ground.track_ids
        for item in found.over_ground.objects:
            bodies = true.body[(ids == item.track_id) & true.dynamic]
            if item.num_points < 30 or len(bodies) < item.num_points / 2:
                continue
            body = simulator.scene.bodies[np.bincount(bodies).argmax() - 1]
            pose = np.linalg.inv(true.pose) @ body.world_from_body(index * 0.1)
            # Which side of the body is seen decides where its middle seems to be.
            offset = np.linalg.inv(pose[:3, :3]) @ (item.center - pose[:3, 3])
            errors_m.append(offset[0])
    assert len(errors_m) > 5
    assert np.abs(np.median(errors_m)) < 0.6
