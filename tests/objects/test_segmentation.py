# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Connected cells, seen from above."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from small_scenes import rows

from mnsf_ros.objects.segmentation import Segmentation


def labels_of(points, cell_size_m=1.0):
    points = rows(*points)
    segmentation = Segmentation(points, cell_size_m)
    return segmentation.num_objects, segmentation.objects_of(points).tolist()


def test_points_in_touching_cells_are_one_object_also_across_a_corner():
    assert labels_of([(0, 0, 0), (1.5, 0, 0), (2.5, 1.5, 0)]) == (2, [1, 1, 1])


def test_an_empty_cell_separates():
    assert labels_of([(0, 0, 0), (2.5, 0, 0)]) == (3, [1, 2])


def test_height_does_not_separate():
    assert labels_of([(0, 0, 0), (0.5, 0, 50)]) == (2, [1, 1])


@pytest.mark.parametrize("extent_m", [1e3, 1e6])
def test_a_huge_extent_is_segmented_coarser(extent_m):
    points = rows((0, 0, 0), (0.5, 0, 0), (extent_m, extent_m, 0))
    segmentation = Segmentation(points, 0.05)
    assert segmentation.objects_of(points).tolist() == ([1, 2, 3] if extent_m < 500 else [1, 1, 2])
    assert segmentation._labels.size <= 2050**2


def test_labels_do_not_depend_on_the_order_of_the_points():
    points = np.random.default_rng(0).uniform(-20, 20, (500, 3)).astype(np.float32)
    order = np.random.default_rng(1).permutation(500)
    first = Segmentation(points, 1.0).objects_of(points)
    second = Segmentation(points[order], 1.0).objects_of(points[order])
    np.testing.assert_array_equal(first[order], second)


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
