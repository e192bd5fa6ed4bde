# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which points belong together: connected cells, seen from above."""

import numpy as np

from mnsf_ros.arrays import Floats32, Ints, Ints32
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.point_sets import MAX_CELLS_PER_AXIS, bounds


class Segmentation:
    """The objects of one sweep, numbered from 1; 0 means none.

    Attributes:
        num_objects: How many there are, number 0 included.
    """

    def __init__(self, points: Floats32, cell_size_m: float) -> None:
        """Segments points that stand on the ground, the ground itself left out.

        Args:
            points: (N, 3) metres, N > 0.
            cell_size_m: Points in touching cells of this size are one object.
        """
        points = np.require(points, requirements=("C", "W"))
        low_x, low_y, high_x, high_y = map(np.float32, bounds(points))
        self._low = low_x, low_y
        extent = float(max(high_x - low_x, high_y - low_y))
        self._cell_size_m = np.float32(max(cell_size_m, extent / MAX_CELLS_PER_AXIS))
        labels, objects, number = _labelled(points, *self._low, high_x, high_y, self._cell_size_m)
        self._labels, self._objects = labels, objects
        self.num_objects = number + 1

    def objects_of(self, points: Floats32) -> Ints:
        """Returns (N,) the object of each of the points (N, 3)."""
        own = np.require(points, requirements=("C", "W"))
        return _labels_at(own, *self._low, self._cell_size_m, self._labels, self._objects)


@compiled("Tuple((int32[::1], int64))(int32[::1], int64)")
def _numbered(roots: Ints32, number: int) -> tuple[Ints32, int]:
    """The number of the root of each label, the lowest root first, and how many roots there are."""
    numbers, num_roots = np.zeros(number + 1, np.int32), 0
    for label in range(1, number + 1):
        # A root is never higher than what leads to it: it has its number already.
        if roots[label] == label:
            num_roots += 1
            numbers[label] = num_roots
        else:
            numbers[label] = numbers[roots[label]]
    return numbers, num_roots


@compiled(
    "Tuple((int32[:, ::1], int32[::1], int64))"
    "(float32[:, ::1], float32, float32, float32, float32, float32)"
)
def _labelled(
    points: Floats32,
    low_x: np.float32,
    low_y: np.float32,
    high_x: np.float32,
    high_y: np.float32,
    cell_size_m: np.float32,
) -> tuple[Ints32, Ints32, int]:
    """Labels of all cells from the lowest one, the object of each label, and how many objects.

    Objects are in the order of their rows.
    """
    num_rows = int((high_x - low_x) / cell_size_m) + 1
    num_columns = int((high_y - low_y) / cell_size_m) + 1
    rows, columns = np.empty(len(points), np.int32), np.empty(len(points), np.int32)
    # Of a flat array the compiler knows the steps: it looks at several points at once.
    values = points.reshape(-1)
    for point in range(len(points)):
        rows[point] = np.int32((values[3 * point] - low_x) / cell_size_m)
        columns[point] = np.int32((values[3 * point + 1] - low_y) / cell_size_m)
    labels, number = np.zeros((num_rows, num_columns), np.int32), 0
    # Most cells are empty: of each row only the columns that points reach are looked at.
    starts, ends = np.full(num_rows, num_columns, np.int32), np.zeros(num_rows, np.int32)
    for point in range(len(points)):
        row, column = rows[point], columns[point]
        labels[row, column] = -1
        starts[row], ends[row] = min(starts[row], column), max(ends[row], column + 1)
    # Each cell takes over a label around it, and the labels that meet get the same root.
    roots = np.empty(len(points) + 1, np.int32)
    for row in range(num_rows):
        for column in range(starts[row], ends[row]):
            if labels[row, column] == 0:
                continue
            root = 0
            for near in range(4):
                other_row = row - 1 if near < 3 else row
                other_column = column - 1 + near % 3
                if other_row < 0 or not 0 <= other_column < num_columns:
                    continue
                other = labels[other_row, other_column]
                if other == 0:
                    continue
                while roots[other] != other:
                    roots[other] = roots[roots[other]]
                    other = roots[other]
                if root == 0:
                    root = other
                roots[max(root, other)] = min(root, other)
                root = min(root, other)
            if root == 0:
                number += 1
                root = number
                roots[root] = root
            labels[row, column] = root
    return labels, *_numbered(roots, number)


@compiled("int64[::1](float32[:, ::1], float32, float32, float32, int32[:, ::1], int32[::1])")
def _labels_at(
    points: Floats32,
    low_x: np.float32,
    low_y: np.float32,
    cell_size_m: np.float32,
    labels: Ints32,
    objects: Ints32,
) -> Ints:
    """The objects at points, none outside."""
    result = np.zeros(len(points), np.int64)
    for point in range(len(points)):
        row = (points[point, 0] - low_x) / cell_size_m
        column = (points[point, 1] - low_y) / cell_size_m
        if 0 <= row < labels.shape[0] and 0 <= column < labels.shape[1]:
            result[point] = objects[labels[int(row), int(column)]]
    return result
