# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of sweeps: motion side by side, and errors from above."""

import io

import numpy as np
from PIL import Image

from mnsf_ros.drawing.street_picture import frame


def picture(*arguments):
    with Image.open(io.BytesIO(frame(*arguments))) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def test_errors_are_drawn_from_above_with_ahead_up():
    xyz = np.array([[25, 0, 0], [0, 25, 0], [-25, 0, 0], [1e6, 0, 0]], np.float32)
    still, errors_m = np.zeros_like(xyz), np.array([0.6, 0.0, np.nan, 0.5])
    two, three = picture(xyz, [still] * 2, 5.0), picture(xyz, [still] * 2, 5.0, errors_m)
    assert (three[:, : two.shape[1]] == two).all()
    above = three[:, -three.shape[0] :]
    red, green, _ = np.moveaxis(above, 2, 0)
    rows, columns = np.nonzero((red > 100) & (green < 100))
    height = len(above)
    assert abs(rows.mean() - height / 4) < 3
    assert abs(columns.mean() - height / 2) < 3

    # To the left, and weaker behind.
    def brightest(row, column):
        return above[row - 3 : row + 4, column - 3 : column + 4].max()

    left, behind = brightest(height // 2, height // 4), brightest(3 * height // 4, height // 2)
    assert left > behind > above[5, 5].max()
