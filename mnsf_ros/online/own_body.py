# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The own body: points that stay at the same place of the sensor frame while the sensor moves."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.online.object_sweep import TOUCH_M, ObjectSweep
from mnsf_ros.settings import CropSettings
from mnsf_ros.sweeps.kept_points import in_boxes
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# Most bodies are within this distance of the sensor, most traffic beside them is not.
_REACH_M: Final = 2.0
# Points of a rigid body repeat within the noise of the ranges. The distance to a companion or to a
# car that drives along changes by more within seconds.
_CELL_M: Final = 0.05
_NUM_CELLS: Final = round(2 * _REACH_M / _CELL_M)
# Sweeps count if this time has passed, and if the sensor has moved by more than a cell.
_EVERY_S: Final = 0.08
# The share of sweeps in which a cell is occupied is a running mean over up to this many; it counts
# from the lower number on, after about a second. Within that the distance to a companion changes.
_NUM_SWEEPS: Final = (10, 20)
_LEAST_SHARE: Final = 0.8


class OwnBody:
    """Learns where the robot's own body is. For one thread at a time."""

    def __init__(self, settings: CropSettings) -> None:
        self._boxes, self._is_learning = settings.own_boxes, settings.own_body == "auto"
        self._shares = np.zeros((_NUM_CELLS,) * 3, np.float32)
        self._num_sweeps = 0
        self._last: ObjectSweep | None = None

    def mask(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Returns (N,) the points of a sweep that are on the own body, as far as it is known."""
        if self._num_sweeps < _NUM_SWEEPS[0]:
            return in_boxes(sweep.xyz, self._boxes)
        return _shares_at(sweep.xyz, self._shares) > _LEAST_SHARE

    def learn(self, sweep: ObjectSweep, before: ObjectSweep) -> None:
        """Counts the cells that a sweep occupies, if the sensor moved.

        Points with others at the same place of the world in an earlier sweep do not count: the
        walls of a corridor stay at the same place of the sensor frame, too.

        Args:
            sweep: The newest sweep.
            before: The earliest sweep that is still known.
        """
        last = self._last or before
        elapsed_s = (sweep.sweep.stamp_ns - last.sweep.stamp_ns) / NANOSECONDS
        has_moved = (
            self._is_learning
            and _travel_m(sweep, last) > _CELL_M
            and _travel_m(sweep, before) > TOUCH_M
        )
        if elapsed_s < _EVERY_S or not has_moved:
            return
        self._last = sweep
        rows = np.flatnonzero(_are_near(sweep.sweep.xyz) & (sweep.kept | sweep.own))
        before_from_world = np.linalg.inv(before.pose.world_from_sensor)
        places = transformed(sweep.xyz[rows], before_from_world @ sweep.pose.world_from_sensor)
        rows = rows[before.grid.nearest(places, TOUCH_M) < 0]
        self._num_sweeps = min(self._num_sweeps + 1, _NUM_SWEEPS[1])
        _average(self._shares, sweep.sweep.xyz[rows], self._num_sweeps)


def _travel_m(sweep: ObjectSweep, before: ObjectSweep) -> float:
    moved = sweep.pose.world_from_sensor[:3, 3] - before.pose.world_from_sensor[:3, 3]
    return float(np.sqrt((moved**2).sum()))


@compiled("boolean[::1](float32[:, ::1])")
def _are_near(xyz: NDArray[np.float32]) -> NDArray[np.bool_]:
    near = np.empty(len(xyz), np.bool_)
    for row in range(len(xyz)):
        x, y, z = xyz[row, 0], xyz[row, 1], xyz[row, 2]
        near[row] = np.sqrt(x * x + y * y + z * z) < _REACH_M - _CELL_M
    return near


@compiled("int64(float32)")
def _first_cell(place_m: np.float32) -> int:
    """The first of two cells: a point near an edge counts on both sides of it."""
    return int((place_m + _REACH_M) / _CELL_M - 0.5)


@compiled("float32[::1](float32[:, ::1], float32[:, :, ::1])")
def _shares_at(xyz: NDArray[np.float32], shares: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (N,) the largest of the shares (C, C, C) of the cells at points (N, 3)."""
    found, near = np.zeros(len(xyz), np.float32), _are_near(xyz)
    for row in np.flatnonzero(near):
        x, y, z = _first_cell(xyz[row, 0]), _first_cell(xyz[row, 1]), _first_cell(xyz[row, 2])
        found[row] = shares[x : x + 2, y : y + 2, z : z + 2].max()
    return found


@compiled("void(float32[:, :, ::1], float32[:, ::1], int64)")
def _average(shares: NDArray[np.float32], xyz: NDArray[np.float32], num_sweeps: int) -> None:
    """Includes points (P, 3) in the running mean of the shares (C, C, C) over so many sweeps."""
    is_occupied = np.zeros(shares.shape, np.bool_)
    for row in range(len(xyz)):
        x, y, z = _first_cell(xyz[row, 0]), _first_cell(xyz[row, 1]), _first_cell(xyz[row, 2])
        is_occupied[x : x + 2, y : y + 2, z : z + 2] = True
    means, occupied = shares.reshape(-1), is_occupied.reshape(-1)
    for cell in range(len(means)):
        means[cell] += (np.float32(occupied[cell]) - means[cell]) / np.float32(num_sweeps)
