# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The own body: points that stay at the same place of the sensor frame while the sensor moves."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.online.object_sweep import SAME_PLACE_M, ObjectSweep
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
# The share of sweeps in which a cell is occupied is a running mean over up to so many.
_MEAN_OVER: Final = 20
# It counts after so many, about a second. Within that the distance to a companion changes.
_MIN_SWEEPS: Final = 10
_LEAST_SHARE: Final = 0.8


class OwnBody:
    """Learns where the robot's own body is. For one thread at a time."""

    def __init__(self, settings: CropSettings) -> None:
        self._boxes, self._is_learning = settings.own_boxes, settings.own_body == "auto"
        self._shares = np.zeros((_NUM_CELLS,) * 3, np.float32)
        self._num_sweeps = 0
        self._frame_id = ""
        self._last: ObjectSweep | None = None

    def begin_with(self, known: "OwnBody") -> None:
        """Takes what was learned before a break of the stream; it holds while `frame_id` stays."""
        self._shares, self._num_sweeps = known._shares.copy(), known._num_sweeps
        self._frame_id = known._frame_id

    def mask(self, sweep: Sweep) -> Bools:
        """Returns (N,) the points of a sweep that are on the own body, as far as it is known."""
        if sweep.frame_id != self._frame_id:
            self._frame_id, self._num_sweeps = sweep.frame_id, 0
        if not self._is_learning or self._num_sweeps < _MIN_SWEEPS:
            return in_boxes(sweep.xyz, self._boxes)
        return _shares_at(sweep.xyz, self._shares) > _LEAST_SHARE

    def learn(self, sweep: ObjectSweep, earliest: ObjectSweep) -> None:
        """Counts the cells that a sweep occupies, if the sensor moved.

        Points with others at the same place of the world in an earlier sweep do not count: the
        walls of a corridor stay at the same place of the sensor frame, too.

        Args:
            sweep: The newest sweep.
            earliest: The earliest sweep that is still known.
        """
        last = self._last or earliest
        elapsed_s = (sweep.stamp_ns - last.stamp_ns) / NANOSECONDS
        has_moved = (
            self._is_learning
            and _travel_m(sweep, last) > _CELL_M
            and _travel_m(sweep, earliest) > SAME_PLACE_M
        )
        if elapsed_s < _EVERY_S or not has_moved:
            return
        self._last = sweep
        rows = np.flatnonzero(_are_near(sweep.input.xyz) & (sweep.kept | sweep.own))
        earliest_from_world = np.linalg.inv(earliest.pose.world_from_sensor)
        places = transformed(sweep.xyz[rows], earliest_from_world @ sweep.pose.world_from_sensor)
        rows = rows[earliest.grid.nearest(places, SAME_PLACE_M) < 0]
        self._num_sweeps = min(self._num_sweeps + 1, _MEAN_OVER)
        _average(self._shares, sweep.input.xyz[rows], self._num_sweeps)


def _travel_m(sweep: ObjectSweep, other: ObjectSweep) -> float:
    moved = sweep.pose.world_from_sensor[:3, 3] - other.pose.world_from_sensor[:3, 3]
    return float(np.sqrt((moved**2).sum()))


@compiled("boolean[::1](float32[:, ::1])")
def _are_near(xyz: Floats32) -> Bools:
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
def _shares_at(xyz: Floats32, shares: Floats32) -> Floats32:
    """Returns (N,) the largest of the shares (C, C, C) of the cells at points (N, 3)."""
    found, near = np.zeros(len(xyz), np.float32), _are_near(xyz)
    for row in np.flatnonzero(near):
        x, y, z = _first_cell(xyz[row, 0]), _first_cell(xyz[row, 1]), _first_cell(xyz[row, 2])
        found[row] = shares[x : x + 2, y : y + 2, z : z + 2].max()
    return found


@compiled("void(float32[:, :, ::1], float32[:, ::1], int64)")
def _average(shares: Floats32, xyz: Floats32, num_sweeps: int) -> None:
    """Includes points (P, 3) in the running mean of the shares (C, C, C) over so many sweeps."""
    is_occupied = np.zeros(shares.shape, np.bool_)
    for row in range(len(xyz)):
        x, y, z = _first_cell(xyz[row, 0]), _first_cell(xyz[row, 1]), _first_cell(xyz[row, 2])
        is_occupied[x : x + 2, y : y + 2, z : z + 2] = True
    means, occupied = shares.reshape(-1), is_occupied.reshape(-1)
    for cell in range(len(means)):
        means[cell] += (np.float32(occupied[cell]) - means[cell]) / np.float32(num_sweeps)
