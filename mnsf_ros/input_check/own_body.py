# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the robot itself is not in the clouds."""

from collections import Counter, deque
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
# Static things are elsewhere after this way.
_WAY_M: Final = 1.0
_MIN_LOOKS: Final = 5
_MAX_LOOKS: Final = 20
_SHARE: Final = 0.8  # of the looks
_MIN_POINTS: Final = 20
# Of all points; the rails on the roof of KITTI's car, .02 %, do no harm.
_SMALL_SHARE: Final = 0.001
# Ground moves along with the sensor as well.
_MIN_HEIGHT_M: Final = 0.3


class OwnBody:
    """Finds near places in the sensor's frame that stay full while the sensor moves."""

    def __init__(self, mounting: Mounting, min_range_m: float) -> None:
        self._mounting, self._min_range_m = mounting, min_range_m
        self._looks: deque[Counter[tuple[int, int, int]]] = deque(maxlen=_MAX_LOOKS)
        self._way_m, self._num_points = np.inf, 1

    def add(self, sample: SweepSample) -> None:
        """The body is seen by motion."""

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        self._way_m += step.way_m
        if self._way_m < _WAY_M:
            return
        self._way_m, self._num_points = 0.0, max(len(step.after.sweep), 1)
        near = self._near(step.after.sweep.xyz)
        cells = np.floor(near / _CELL_M).astype(np.int64)
        self._looks.append(Counter(map(tuple, cells.tolist())))

    def facts(self) -> dict[str, str]:
        """Its points, in words."""
        if len(self._looks) < _MIN_LOOKS:
            return {"own body": "unknown: the sensor does not move enough"}
        number, reach_m = self._found()
        return {"own body": f"{number} points within {reach_m:.1f} m" if number else "none"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if len(self._looks) < _MIN_LOOKS:
            return
        number, reach_m = self._found()
        if number >= _MIN_POINTS:
            share = number / self._num_points
            severity = Severity.WARNING if share > _SMALL_SHARE else Severity.INFO
            found = f"own body: {number} points within {reach_m:.1f} m move along with the sensor"
            remedy = f"Leave them out: crop.min_range_m={reach_m + 0.1:.1f}"
            yield Finding(_ASSUMPTION, severity, found, remedy)

    def _near(self, xyz: NDArray[np.float32]) -> NDArray[np.float32]:
        x, y, z = xyz.T
        rows = np.flatnonzero(
            (np.abs(x) < _REACH_M) & (np.abs(y) < _REACH_M) & (np.abs(z) < _REACH_M)
        )
        near = xyz[rows]
        ranges = np.linalg.norm(near, axis=1)
        is_near = (ranges < _REACH_M) & (ranges > self._min_range_m)
        if (ground := self._mounting.ground) is not None:
            is_near &= near @ ground[:3] + ground[3] > _MIN_HEIGHT_M
        return near[is_near]

    def _found(self) -> tuple[int, float]:
        """Points of a sweep on the body, and how far it reaches."""
        seen = Counter(cell for look in self._looks for cell in look)
        own = {cell for cell, number in seen.items() if number >= _SHARE * len(self._looks)}
        if not own:
            return 0, 0.0
        number = np.median([sum(look[cell] for cell in own) for look in self._looks])
        reach_m = np.linalg.norm((np.array(list(own)) + 0.5) * _CELL_M, axis=1).max()
        return int(number), float(reach_m)
