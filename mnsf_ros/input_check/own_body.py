# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the robot itself is not in the clouds."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.mounting import Mounting
from mnsf_ros.input_check.sweep_sample import Step, SweepSample

_ASSUMPTION: Final = "the robot itself is not in the clouds"
_REACH_M: Final = 3.0
_CELL_M: Final = 0.1
_NUM_CELLS: Final = 60
# Static things are elsewhere after this way.
_WAY_M: Final = 1.0
_MIN_STEPS: Final = 5
_MIN_LOOKS: Final = 4
_MAX_LOOKS: Final = 20
_SHARE: Final = 0.8  # of the looks
_MIN_POINTS: Final = 20
# Of all points; the rails on the roof of KITTI's car, .02 %, do no harm.
_SMALL_SHARE: Final = 0.001
# A wall or a rail along the way moves along as well, until the sensor turns, and ends farther out.
_MARGIN_M: Final = 0.2
_TURN_RAD: Final = 0.5
# Ground moves along with the sensor as well.
_MIN_HEIGHT_M: Final = 0.3


class OwnBody:
    """Finds near places in the sensor's frame that stay full while the sensor moves."""

    def __init__(self, mounting: Mounting, min_range_m: float) -> None:
        self._mounting, self._min_range_m = mounting, min_range_m
        self._num_looks = 0
        # Of each cell around the sensor: looks in which it was full, and points in all of them.
        self._num_full: NDArray[np.int64] = np.zeros(_NUM_CELLS**3, np.int64)
        self._num_points: NDArray[np.int64] = np.zeros(_NUM_CELLS**3, np.int64)
        self._way_m, self._num_steps, self._size = np.inf, _MIN_STEPS, 1
        self._first_turn: NDArray[np.float64] | None = None
        self._turned_rad = 0.0

    def add(self, sample: SweepSample) -> None:
        """The body is seen by motion."""

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        self._way_m += step.way_m
        self._num_steps += 1
        if self._way_m < _WAY_M or self._num_steps < _MIN_STEPS or self._num_looks >= _MAX_LOOKS:
            return
        self._way_m, self._num_steps, self._size = 0.0, 0, max(len(step.after.sweep), 1)
        near = self._near(step.after.sweep.xyz)
        x, y, z = np.floor((near + _REACH_M) / _CELL_M).astype(np.int64).T
        counts = np.bincount((x * _NUM_CELLS + y) * _NUM_CELLS + z, minlength=_NUM_CELLS**3)
        self._num_points += counts
        self._num_full += counts > 0
        self._num_looks += 1
        turn = step.after.world_from_sensor[:3, :3]
        self._first_turn = turn if self._first_turn is None else self._first_turn
        cosine = (np.trace(self._first_turn.T @ turn) - 1) / 2
        self._turned_rad = max(self._turned_rad, float(np.arccos(np.clip(cosine, -1, 1))))

    def facts(self) -> dict[str, str]:
        """Its points, in words."""
        if self._num_looks < _MIN_LOOKS:
            return {"own body": "unknown: the sensor does not move enough"}
        number, reach_m = self._found()
        return {"own body": f"{number} points within {reach_m:.1f} m" if number else "none"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._num_looks < _MIN_LOOKS:
            return
        number, reach_m = self._found()
        if number >= _MIN_POINTS:
            may_be_wall = reach_m > _REACH_M - _MARGIN_M and self._turned_rad < _TURN_RAD
            is_small = number < _SMALL_SHARE * self._size
            severity = Severity.INFO if may_be_wall or is_small else Severity.WARNING
            body = "own body, or a wall alongside" if may_be_wall else "own body"
            found = f"{body}: {number} points within {reach_m:.1f} m move along with the sensor"
            remedy = f"Leave them out: crop.min_range_m={reach_m + 0.1:.1f}"
            yield Finding(_ASSUMPTION, severity, found, remedy)

    def _near(self, xyz: NDArray[np.float32]) -> NDArray[np.float32]:
        """The points (M, 3) that may be of the body."""
        squared = np.einsum("ij,ij->i", xyz, xyz)
        near = xyz[(squared < _REACH_M**2) & (squared > self._min_range_m**2)]
        if (ground := self._mounting.ground) is not None:
            near = near[near @ ground[:3] + ground[3] > _MIN_HEIGHT_M]
        return near

    def _found(self) -> tuple[int, float]:
        """Points of a sweep on the body, and how far it reaches."""
        own = np.flatnonzero(self._num_full >= _SHARE * self._num_looks)
        if len(own) == 0:
            return 0, 0.0
        cells = np.stack(np.unravel_index(own, (_NUM_CELLS,) * 3), axis=1)
        reach_m = np.linalg.norm((cells + 0.5) * _CELL_M - _REACH_M, axis=1).max()
        return round(int(self._num_points[own].sum()) / self._num_looks), float(reach_m)
