# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: rays without a return give no point."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step, SweepSample

_ASSUMPTION: Final = "rays without a return give no point"
_MAX_ZEROS: Final = 0.001
# Of the points, within .1 m of one range near the farthest one; a wall around the sensor is never
# as even, and sweeps have .5 % there at most.
_MAX_SHELL: Final = 0.03
_EVERY: Final = 5  # sweeps
_THICKNESS_M: Final = 0.1
_NEAR_END: Final = 0.97
_MIN_DIRECTIONS: Final = 12  # of 72


class NoReturns:
    """Counts points at the origin, points that are not finite, and those on a sphere."""

    def __init__(self) -> None:
        self._zeros: deque[float] = deque(maxlen=100)
        self._lost: deque[float] = deque(maxlen=100)
        self._shells: deque[tuple[float, float]] = deque(maxlen=100)  # share, metres
        self._num = 0

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        self._zeros.append(sample.zero_share)
        if sample.cloud is not None:
            self._lost.append(1 - len(sample.sweep) / max(len(sample.cloud.finite), 1))
        self._num += 1
        if len(sample.ranges) and self._num % _EVERY == 1:
            self._shells.append(_shell(sample))

    def move(self, step: Step) -> None:
        """They are seen without motion."""

    def facts(self) -> dict[str, str]:
        """Shares of no-returns, in words."""
        if not self._zeros:
            return {}
        lost = f"{np.median(self._lost):.1%} left out when read, " if self._lost else ""
        return {"no returns": f"{lost}{np.median(self._zeros):.1%} are (0, 0, 0)"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._zeros and (share := np.median(self._zeros)) > _MAX_ZEROS:
            found = f"{share:.1%} of the points are exactly (0, 0, 0)"
            remedy = "Let the driver leave out rays without a return"
            yield Finding(_ASSUMPTION, Severity.WARNING, found, remedy)
        if not self._shells:
            return
        share, range_m = np.median(self._shells, axis=0)
        if share > _MAX_SHELL:
            yield Finding(
                _ASSUMPTION,
                Severity.ERROR,
                f"{share:.0%} of the points are {range_m:.1f} m away in all directions, where "
                "nothing is farther: rays without a return",
                f"Leave them out: crop.max_range_m={0.97 * range_m:.0f}",
            )


def _shell(sample: SweepSample) -> tuple[float, float]:
    """Share of the points on a sphere near the farthest range, and its radius."""
    end_m = float(np.quantile(sample.ranges, 0.995))
    far = sample.ranges > _NEAR_END * end_m
    middle_m = float(np.median(sample.ranges[far]))
    on = np.abs(sample.ranges - middle_m) < _THICKNESS_M / 2
    cells = ((sample.azimuths[on] + np.pi) * 72 / (2 * np.pi)).astype(np.int64)
    share = float(np.mean(on)) if len(np.unique(cells)) >= _MIN_DIRECTIONS else 0.0
    return share, middle_m
