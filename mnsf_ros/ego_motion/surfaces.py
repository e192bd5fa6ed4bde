# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Surfaces of points in cells: fitted to their moments, and compared with other points.

A surface has a center and a (3, 3) matrix of weights: 1 across a smooth plane, 0 along it. An
upright pole or edge counts in two directions, and a cell without a flat surface in none. Points of
a single laser do not count in the direction of its elevation.
"""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Ints, Ints32
from mnsf_ros.compiled import compiled

# A surface needs this many points. It is fitted again when a fifth of its points are new.
_MIN_POINTS: Final = 4
_MIN_NEW: Final = 0.2
# The weight of a cell's points is limited, so that changes take effect sooner.
_MAX_POINTS: Final = 100.0
# A surface with this roughness (standard deviation) counts half.
_ROUGHNESS_M: Final = 0.03
# Turns of Jacobi's method, three a round: three rounds give all digits of float32.
_NUM_TURNS: Final = 9


@compiled(
    "void(float64[:, ::1], int32[::1], int64[:, ::1], float64, float64[:, :, ::1], float64[::1])"
)
def add_moments(
    points: Floats, cells: Ints32, indices: Ints, cell_m: float, moments: Floats, num_new: Floats
) -> None:
    """Adds points to the moments of their cells.

    Args:
        points: (N, 3) metres.
        cells: (N,) their cells.
        indices: (C, 3) index of each cell along the axes.
        cell_m: Size of the cells.
        moments: (C, 4, 4) sums of the products of (x, y, z, 1) from the middle of the cell.
        num_new: (C,) how many points were added since the surface was fitted.
    """
    place = np.ones(4)
    for row in range(len(points)):
        cell = cells[row]
        num_new[cell] += 1.0
        for axis in range(3):
            place[axis] = points[row, axis] - (indices[cell, axis] + 0.5) * cell_m
        kept = 1.0 if moments[cell, 3, 3] < _MAX_POINTS else 1.0 - 1.0 / _MAX_POINTS
        for first in range(4):
            for second in range(4):
                moment = kept * moments[cell, first, second]
                moments[cell, first, second] = moment + place[first] * place[second]


@compiled("void(float64[:, ::1], float64[:, ::1])")
def _find_axes(spread: Floats, axes: Floats) -> None:
    """Diagonalizes a symmetric (3, 3) matrix; columns of `axes`: its eigenvectors (Jacobi)."""
    for row in range(3):
        for column in range(3):
            axes[row, column] = 1.0 if row == column else 0.0
    for turn in range(_NUM_TURNS):
        one, other = turn % 3, (turn + 1) % 3
        if spread[one, other] == 0.0:
            continue
        half = (spread[other, other] - spread[one, one]) / (2 * spread[one, other])
        tangent = 1 / (abs(half) + np.sqrt(half * half + 1))
        if half < 0:
            tangent = -tangent
        cosine = 1 / np.sqrt(tangent * tangent + 1)
        sine = tangent * cosine
        for row in range(3):
            first, second = spread[row, one], spread[row, other]
            spread[row, one] = cosine * first - sine * second
            spread[row, other] = sine * first + cosine * second
        for column in range(3):
            first, second = spread[one, column], spread[other, column]
            spread[one, column] = cosine * first - sine * second
            spread[other, column] = sine * first + cosine * second
            first, second = axes[column, one], axes[column, other]
            axes[column, one] = cosine * first - sine * second
            axes[column, other] = sine * first + cosine * second


@compiled("void(float64[:, ::1], float64[::1], float64[::1], float64[::1])")
def _find_unseen(spread: Floats, ray: Floats, beam_axis: Floats, unseen: Floats) -> None:
    """Direction of the elevation of lasers; its squared length is the share that is unknown.

    The points of one laser lie in the plane of its rays on any surface, and move along with the
    sensor when it pitches, rolls or heaves.
    """
    climb, squared = 0.0, 0.0
    for axis in range(3):
        climb += ray[axis] * beam_axis[axis]
        squared += ray[axis] * ray[axis]
    length, seen = 0.0, 0.0
    for axis in range(3):
        unseen[axis] = squared * beam_axis[axis] - climb * ray[axis]
        length += unseen[axis] * unseen[axis]
    if length == 0.0:
        return
    for first in range(3):
        for second in range(3):
            seen += unseen[first] * spread[first, second] * unseen[second] / length
    scale = np.sqrt(_ROUGHNESS_M**2 / (max(seen, 0.0) + _ROUGHNESS_M**2) / length)
    for axis in range(3):
        unseen[axis] *= scale


@compiled("void(float64[:, ::1], float64[:, ::1], float64, float64[::1], float64[::1])")
def _weigh(spread: Floats, axes: Floats, cell_m: float, unseen: Floats, weights: Floats) -> None:
    """Weights of the three axes, by the variances of the points along them."""
    rough = _ROUGHNESS_M**2
    least, most = 0, 0
    for axis in range(3):
        # If points fill the cell along this axis, they do not locate the surface on it.
        share = rough / (max(spread[axis, axis], 0.0) + rough)
        part = 0.0
        for row in range(3):
            part += axes[row, axis] * unseen[row]
        weights[axis] = max(share - rough / (cell_m**2 / 12 + rough), 0.0) * (1 - part * part)
        if spread[axis, axis] < spread[least, least]:
            least = axis
        if spread[axis, axis] >= spread[most, most]:
            most = axis
    if least != most:
        # Points on a line that is not upright are those of one laser on any surface: they move
        # along with the sensor.
        weights[3 - least - most] *= axes[2, most] ** 2


@compiled(
    "void(int32[::1], int64[:, ::1], float64, float64[:, :, ::1], float64[::1], float64[:, ::1],"
    " float64[:, :, ::1])"
)
def fit_surfaces(
    cells: Ints32,
    indices: Ints,
    cell_m: float,
    moments: Floats,
    num_new: Floats,
    sensor: Floats,
    surfaces: Floats,
) -> None:
    """Fits the surfaces (C, 4, 3) of cells with enough points and enough new ones.

    The rows of `sensor` are its place and the axis of its beams. The other arguments are those of
    `add_moments`.
    """
    spread, axes, weights = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    ray, unseen = np.empty(3), np.zeros(3)
    for cell in cells:
        count = moments[cell, 3, 3]
        if count < _MIN_POINTS or num_new[cell] < _MIN_NEW * count:
            continue
        num_new[cell] = 0.0
        for first in range(3):
            mean = moments[cell, first, 3] / count
            surfaces[cell, 0, first] = (indices[cell, first] + 0.5) * cell_m + mean
            ray[first] = surfaces[cell, 0, first] - sensor[0, first]
            for second in range(3):
                product = moments[cell, first, second] / count
                spread[first, second] = product - mean * moments[cell, second, 3] / count
        _find_unseen(spread, ray, sensor[1], unseen)
        _find_axes(spread, axes)
        _weigh(spread, axes, cell_m, unseen, weights)
        for first in range(3):
            for second in range(3):
                total = 0.0
                for axis in range(3):
                    total += weights[axis] * axes[first, axis] * axes[second, axis]
                surfaces[cell, 1 + first, second] = total


@compiled("UniTuple(float64, 3)(UniTuple(float64, 3), float64, float64, float64)")
def _cross(arm: tuple[float, float, float], x: float, y: float, z: float) -> tuple[float, ...]:
    """The cross product of an arm and a vector."""
    across, along, up = arm
    return along * z - up * y, up * x - across * z, across * y - along * x


@compiled(
    "void(float64, UniTuple(float64, 3), UniTuple(float64, 3), int64, float64[:, :, ::1], int64,"
    " float64[:, :, ::1])"
)
def _add_equations(
    weight: float,
    arm: tuple[float, float, float],
    pull: tuple[float, float, float],
    cell: int,
    surfaces: Floats,
    part: int,
    equations: Floats,
) -> None:
    """Adds the equation of one point; a turn moves it by its product with the arm to the sensor."""
    turn = _cross(arm, *pull)
    by_x = _cross(arm, surfaces[cell, 1, 0], surfaces[cell, 1, 1], surfaces[cell, 1, 2])
    by_y = _cross(arm, surfaces[cell, 2, 0], surfaces[cell, 2, 1], surfaces[cell, 2, 2])
    by_z = _cross(arm, surfaces[cell, 3, 0], surfaces[cell, 3, 1], surfaces[cell, 3, 2])
    for axis in range(3):
        x, y, z = weight * by_x[axis], weight * by_y[axis], weight * by_z[axis]
        turns = _cross(arm, x, y, z)
        equations[part, axis, 6] += weight * pull[axis]
        equations[part, 3 + axis, 6] += weight * turn[axis]
        for first in range(3):
            equations[part, first, axis] += weight * surfaces[cell, 1 + first, axis]
        equations[part, 0, 3 + axis] += x
        equations[part, 1, 3 + axis] += y
        equations[part, 2, 3 + axis] += z
        equations[part, 3, 3 + axis] += turns[0]
        equations[part, 4, 3 + axis] += turns[1]
        equations[part, 5, 3 + axis] += turns[2]


@compiled(
    "Tuple((float64, int64))(float64[:, ::1], int32[::1], int32[::1], float64[:, :, ::1],"
    " UniTuple(float64, 3), float64, float64[:, :, ::1])"
)
def compare(
    points: Floats,
    parts: Ints32,
    cells: Ints32,
    surfaces: Floats,
    sensor: tuple[float, float, float],
    noise_m: float,
    equations: Floats,
) -> tuple[float, int]:
    """Compares points with the surfaces of their cells.

    Args:
        points: (N, 3) metres.
        parts: (N,) their parts.
        cells: (N,) their cells, -1 for none.
        surfaces: (C, 4, 3) the center of each surface, and its weights.
        sensor: Metres, the center of turns.
        noise_m: A point at this distance from its surface counts half.
        equations: (K, 6, 7) zeros; becomes, for each part, the curvature by a shift, then a turn,
            if the weights of points stay as they are, and in the last column the gradient of
            -noise^2 / 2 times the support.

    Returns:
        The support: a point on its surface counts 1, a point off it less. And the number of points
        in cells.
    """
    support, known, variance = 0.0, 0, noise_m * noise_m
    for row in range(len(points)):
        cell = int(cells[row])
        if cell < 0:
            continue
        known += 1
        # Not in rows of `surfaces`: making one for each point takes longer than all the rest.
        if surfaces[cell, 1, 0] + surfaces[cell, 2, 1] + surfaces[cell, 3, 2] == 0.0:
            continue
        px, py, pz = points[row, 0], points[row, 1], points[row, 2]
        x, y, z = px - surfaces[cell, 0, 0], py - surfaces[cell, 0, 1], pz - surfaces[cell, 0, 2]
        # Half of the derivative of the squared distance.
        pull_x = surfaces[cell, 1, 0] * x + surfaces[cell, 1, 1] * y + surfaces[cell, 1, 2] * z
        pull_y = surfaces[cell, 2, 0] * x + surfaces[cell, 2, 1] * y + surfaces[cell, 2, 2] * z
        pull_z = surfaces[cell, 3, 0] * x + surfaces[cell, 3, 1] * y + surfaces[cell, 3, 2] * z
        squared = max(pull_x * x + pull_y * y + pull_z * z, 0.0)
        # 1 less Geman and McClure's loss, its weight is the square: what moves along hardly counts.
        near = variance / (variance + squared)
        support += near
        arm = px - sensor[0], py - sensor[1], pz - sensor[2]
        pull, part = (pull_x, pull_y, pull_z), int(parts[row])
        _add_equations(near * near, arm, pull, cell, surfaces, part, equations)
    for part in range(len(equations)):
        for first in range(3):
            for axis in range(3):
                equations[part, 3 + axis, first] = equations[part, first, 3 + axis]
    return support, known
