# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Registration on streets full of traffic and on empty squares, at speed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from box_street import distance_m
from scipy.stats import chi2

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep


def seconds(sweep):
    times_ns = sweep.columns.get("t")
    return None if times_ns is None else (times_ns / 1e9).astype(np.float32)


STREET = SimulationSettings(duration_s=3.0, num_beams=32, num_columns=1400)
WORLD = SimulationSettings(scenario="random")


@pytest.mark.parametrize(
    ("settings", "within_m"),
    [
        (replace(STREET, seed=2, ego_speed_m_s=18.0), 0.007),
        (replace(STREET, seed=1), 0.009),
        # A country road with lorries and a tunnel: registration was dragged along by traffic.
        (replace(WORLD, seed=5), 0.02),
        (replace(WORLD, seed=43), 0.04),
        # 17 m/s from the first sweep on, and 16 lasers on a robot that sways.
        (replace(WORLD, seed=20), 0.03),
        (replace(WORLD, seed=7), 0.008),
        # Squares with little on them, 16 lasers: pitch and roll went on without end, or the few
        # points on surfaces were refused.
        (replace(WORLD, seed=185), 0.02),
        (replace(WORLD, seed=164), 0.04),
        # A tunnel at 24 m/s, behind a car of the same speed, which was taken for standing.
        (replace(WORLD, seed=265), 0.1),
        # A street whose parked cars and poles lie on others 1.1 m farther on nearly as well.
        (replace(WORLD, seed=1607), 0.02),
        # Who stands in a tunnel was dragged along by the traffic.
        (replace(WORLD, seed=1572), 0.02),
        # A solid-state lidar that stands on a square: the map alone hardly says where, and began
        # anew in one of three sweeps.
        (replace(WORLD, seed=700), 0.02),
    ],
)
def test_the_error_of_a_step_is_small_and_as_likely_as_its_covariance_says(settings, within_m):
    """Poles, corners and parked cars say how far the sensor went; they need points."""
    simulator, ego_motion = SweepSimulator(settings), EgoMotion(EgoMotionSettings())
    sweeps = [simulator.sweep(index) for index in range(11)]
    found = [
        ego_motion.pose_of(Sweep(sweep.xyz, sweep.truth.stamp_ns, times_s=seconds(sweep)))
        for sweep in sweeps
    ]
    assert {item.source for item in found[1:]} == {EgoSource.REGISTRATION}
    errors_m, squared = [], []
    for (before, after), (was, is_) in zip(pairwise(found), pairwise(sweeps), strict=True):
        step = np.linalg.inv(before.world_from_sensor) @ after.world_from_sensor
        true = np.linalg.inv(was.pose) @ is_.pose
        error = (step - true)[:2, 3]
        errors_m.append(distance_m(step, true))
        squared.append(error @ np.linalg.solve(after.step_covariance[:2, :2], error))
    assert np.mean(errors_m) < within_m
    assert np.median(squared) < chi2.ppf(0.9, df=2)
