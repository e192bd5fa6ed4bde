# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Registration on streets full of traffic and on empty squares, at speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_street import distance_m

from mnsf_ros.ego_motion.ego_motion import EgoMotion
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep


def seconds(sweep):
    return None if sweep.times_ns is None else (sweep.times_ns / 1e9).astype(np.float32)


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
        # A square with little on it, 16 tilted lasers: pitch and roll went on without end.
        (replace(WORLD, seed=185), 0.02),
    ],
)
def test_the_error_of_a_step_is_small(settings, within_m):
    """Poles, corners and parked cars say how far the sensor went; they need points."""
    simulator, ego_motion = SweepSimulator(settings), EgoMotion(EgoMotionSettings())
    sweeps = [simulator.sweep(index) for index in range(11)]
    found = [
        ego_motion.pose_of(
            Sweep(sweep.xyz, sweep.stamp_ns, times_s=seconds(sweep))
        ).world_from_sensor
        for sweep in sweeps
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
