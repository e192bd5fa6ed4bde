# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Registration on streets full of traffic, at speed."""

from __future__ import annotations

import numpy as np
import pytest
from box_street import distance_m

from mnsf_ros.ego_motion.ego_motion import EgoMotion
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep


@pytest.mark.parametrize(
    ("seed", "scenario", "speed_m_s", "within_m"),
    [
        (2, "street", 18.0, 0.007),
        (1, "street", 8.0, 0.009),
        # Registration was dragged along by lorries and cars: 0.6 m and 1.3 m a sweep.
        (3, "lorry", 8.0, 0.02),
        (3, "tunnel", 12.0, 0.08),
    ],
)
def test_the_error_of_a_step_is_small(seed, scenario, speed_m_s, within_m):
    """Poles, corners and parked cars say how far the sensor went; they need points."""
    street = SimulationSettings(
        seed=seed,
        scenario=scenario,
        ego_speed_m_s=speed_m_s,
        duration_s=3.0,
        num_beams=32,
        num_columns=1400,
    )
    simulator, ego_motion = SweepSimulator(street), EgoMotion(EgoMotionSettings())
    sweeps = [simulator.sweep(index) for index in range(11)]
    found = [
        ego_motion.pose_of(Sweep(sweep.xyz, sweep.stamp_ns)).world_from_sensor for sweep in sweeps
    ]
    true = [sweep.world_from_sensor for sweep in sweeps]
    errors_m = [
        distance_m(
            np.linalg.inv(found[index]) @ found[index + 1],
            np.linalg.inv(true[index]) @ true[index + 1],
        )
        for index in range(10)
    ]
    assert np.mean(errors_m) < within_m
