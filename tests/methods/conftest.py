# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A street seen from a sensor that moves."""

import pytest
from moving_sweeps import moving_triplet


@pytest.fixture
def translated(make_scene):
    """Five sweeps of a street in which every point has the same flow."""
    return moving_triplet(make_scene(points_per_box=20).current)
