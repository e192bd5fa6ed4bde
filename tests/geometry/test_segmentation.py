# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Connected cells, seen from above."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from mnsf_ros.geometry.segmentation import Segmentation


@pytest.mark.parametrize("extent_m", [1e3, 1e6])
def test_a_huge_extent_is_segmented_coarser(extent_m):
    points = np.float32([(0, 0, 0), (0.5, 0, 0), (extent_m, extent_m, 0)])
    segmentation = Segmentation(points, 0.05)
    assert segmentation.objects_of(points).tolist() == ([1, 2, 3] if extent_m < 500 else [1, 1, 2])
    assert segmentation._labels.size <= 2050**2


@pytest.mark.parametrize("spread", [0.3, 3.0, 40.0, 1e20])
@pytest.mark.parametrize("number", [1, 40, 3000])
def test_numbers_are_those_of_connected_components_row_by_row(number, spread):
    points = np.random.default_rng(number).normal(0, spread, (number, 3)).astype(np.float32)
    extent = np.ptp(points[:, :2], axis=0).max()
    cell_size_m = np.float32(max(0.5, float(extent) / 2048))
    cells = ((points[:, :2] - points[:, :2].min(axis=0)) / cell_size_m).astype(int)
    occupied = np.zeros(cells.max(axis=0) + 1, bool)
    occupied[tuple(cells.T)] = True
    labels, num_labels = ndimage.label(occupied, np.ones((3, 3)))
    found = Segmentation(points, 0.5)
    assert found.num_objects == num_labels + 1
    np.testing.assert_array_equal(found.objects_of(points), labels[tuple(cells.T)])
