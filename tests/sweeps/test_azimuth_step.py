# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The angle between the columns of a lidar."""

import numpy as np
import pytest

from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.azimuth_step import azimuth_step


@pytest.mark.parametrize(("num_beams", "num_columns"), [(16, 360), (32, 600), (64, 1900)])
def test_is_that_of_the_columns(num_beams, num_columns):
    settings = SimulationSettings(num_beams=num_beams, num_columns=num_columns, duration_s=0.1)
    found = azimuth_step(SweepSimulator(settings).sweep(0).xyz)
    assert found == pytest.approx(2 * np.pi / num_columns, rel=0.05)


@pytest.mark.parametrize("xyz", [np.zeros((0, 3)), np.zeros((100, 3)), np.full((30, 3), 1e20)])
def test_is_unknown_without_a_beam(xyz):
    assert azimuth_step(xyz.astype(np.float32)) == 0.0
