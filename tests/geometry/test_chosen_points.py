# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points by a mask, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.geometry.chosen_points import chosen_points


@pytest.mark.parametrize("number", [0, 1, 1000])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_they_are_those_of_the_mask(number, share):
    generator = np.random.default_rng(0)
    xyz = generator.normal(size=(number, 3)).astype(np.float32)
    mask = generator.random(number) < share
    found = chosen_points(xyz, mask)
    np.testing.assert_array_equal(found, xyz[mask])
    assert found.dtype == np.float32
    assert not np.shares_memory(found, xyz)
