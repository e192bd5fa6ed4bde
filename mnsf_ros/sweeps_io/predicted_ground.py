# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Prediction of dynamic objects: the ground under their boxes over the next seconds."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats
from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.sweeps.mounting import Mounting

_CELL_M: Final = 0.2
# No cell is missed between samples this far apart, however they are turned.
_SPACING_M: Final = 0.7 * _CELL_M
_LONGEST_STEP_S: Final = 0.2
# Rays 0.05 degrees apart, to beyond the border of a costmap, pass each cell of 0.05 m within 28 m.
_NUM_RAYS: Final = 7200
_RING_M: Final = 100.0
# Half a lane: less certain places would block the way.
_MAX_DEVIATION_M: Final = 1.5


def predicted_columns(
    objects: Sequence[TrackedObject], horizon_s: float
) -> dict[str, NDArray[Any]]:
    """Returns the ground that objects will cover, as columns (P,): one point in each cell of it.

    Each object keeps its velocity and its turn rate. Its box grows on all sides by the standard
    deviation of the predicted place; the prediction ends when that exceeds 1.5 m. `x`, `y`, `z` are
    metres in the frame of the objects, at the height of the box's middle; `ahead` is the earliest
    time of an object there, seconds from the stamp up to the horizon; `id` is its `track_id`.
    """
    parts = [np.zeros((0, 5)), *(_covered(item, horizon_s) for item in objects)]
    points = np.concatenate(parts)
    points = points[np.argsort(points[:, 3], kind="stable")]
    cells = np.floor(points[:, :2] / _CELL_M)
    _, first = np.unique(cells.astype(np.int64) @ (1 << 32, 1), return_index=True)
    first = np.sort(first)
    points[:, :2] = (cells + 0.5) * _CELL_M
    *places, ahead, ids = points[first].T
    columns = dict(zip("xyz", places, strict=True), ahead=ahead)
    return {name: column.astype(np.float32) for name, column in columns.items()} | {
        "id": ids.astype(np.uint32)
    }


def clearing_columns(mounting: Mounting | None) -> dict[str, NDArray[Any]]:
    """Returns `x`, `y`, `z`, (P,) metres, of a level ring around the sensor.

    Rays to it clear all cells of a costmap that earlier predictions have marked.
    """
    angles = np.linspace(0.0, 2 * np.pi, _NUM_RAYS, endpoint=False)
    ring = _RING_M * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    if mounting is not None:
        ring = ring @ mounting.sensor_from_level[:3, :3].T
    return {name: ring[:, axis].astype(np.float32) for axis, name in enumerate("xyz")}


def _covered(item: TrackedObject, horizon_s: float) -> AnyFloats:
    """(P, 5) x, y, z, time and `track_id` of samples of the ground that an object will cover."""
    speed_m_s = max(math.hypot(*item.velocity[:2].tolist()), _CELL_M)
    direction = np.abs(_rotations(np.array(-item.yaw)) @ item.velocity[:2]) / speed_m_s
    # From one time to the next, half of the box overlaps.
    step_s = max(float(item.size[:2] @ direction), _CELL_M) / 2 / speed_m_s
    num_steps = math.ceil(horizon_s / min(step_s, _LONGEST_STEP_S))
    times_s = np.linspace(0.0, horizon_s, num_steps + 1)
    deviations_m = _deviations_m(item, times_s)
    if (unknown := (deviations_m > _MAX_DEVIATION_M).any(axis=1)).any():
        times_s, deviations_m = times_s[: unknown.argmax()], deviations_m[: unknown.argmax()]
    half = item.size[:2] / 2 + deviations_m
    numbers = np.ceil(2 * half.max(axis=0, initial=0.0) / _SPACING_M).astype(int) + 1
    grid = np.meshgrid(*(np.linspace(-1, 1, number) for number in numbers))
    offsets = np.stack([axis.ravel() for axis in grid], axis=1) * half[:, None]  # (T, G, 2)
    turned = _rotations(item.yaw + item.turn_rate * times_s) @ offsets.swapaxes(1, 2)
    points = np.empty((*offsets.shape[:2], 5))
    points[:, :, :3] = (item.center + _ways(item, times_s))[:, None]
    points[:, :, :2] += turned.swapaxes(1, 2)
    points[:, :, 3], points[:, :, 4] = times_s[:, None], item.track_id
    return points.reshape(-1, 5)


def _ways(item: TrackedObject, times_s: AnyFloats) -> AnyFloats:
    """(T, 3) metres that an object covers at constant speed and turn rate."""
    # The mean direction of an arc is the direction in its middle.
    half_turns = item.turn_rate * times_s / 2
    chords = times_s * np.sinc(half_turns / np.pi)
    ways = np.outer(times_s, item.velocity)
    ways[:, :2] = chords[:, None] * (_rotations(half_turns) @ item.velocity[:2])
    return ways


def _deviations_m(item: TrackedObject, times_s: AnyFloats) -> AnyFloats:
    """(T, 2) standard deviations of the predicted place, along the heading and across it."""
    turn = _rotations(np.array(-item.yaw))
    places, both, velocities = (
        np.diagonal(turn @ item.covariance[rows : rows + 2, columns : columns + 2] @ turn.T)
        for rows, columns in ((0, 0), (0, 3), (3, 3))
    )
    times = times_s[:, None]
    return np.sqrt(np.maximum(places + 2 * times * both + times**2 * velocities, 0.0))


def _rotations(angles: AnyFloats) -> AnyFloats:
    """(..., 2, 2) turns by angles (...), radians."""
    cosines, sines = np.cos(angles), np.sin(angles)
    rows = np.stack([cosines, -sines, sines, cosines], axis=-1)
    return rows.reshape(*angles.shape, 2, 2)
