# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: a cloud is one revolution, or the whole view of a lidar that does not turn."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import NUM_SECTORS, Step, SweepSample
from mnsf_ros.sweeps.kept_points import MIN_POINTS

_ASSUMPTION: Final = "a cloud is one revolution"
# Of the directions of a cloud, seen in the cloud before, too: whole clouds have .9 and more.
_MIN_COMMON: Final = 0.6
_MIN_SWEEPS: Final = 4
_NUM_VIEWS: Final = 20  # clouds whose elevations are looked at


class Revolution:
    """Compares the directions of neighbouring clouds."""

    def __init__(self) -> None:
        self._sectors: deque[NDArray[np.bool_]] = deque(maxlen=60)
        self._counts: deque[int] = deque(maxlen=60)
        self._low, self._high = np.inf, -np.inf

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        self._sectors.append(sample.sectors)
        self._counts.append(len(sample.sweep))
        if len(sample.xyz) and len(self._counts) < _NUM_VIEWS:
            low, high = np.quantile(sample.elevations, (0.002, 0.998))
            self._low, self._high = min(self._low, low), max(self._high, high)

    def move(self, step: Step) -> None:
        """Directions are seen without motion."""

    def facts(self) -> dict[str, str]:
        """View and number of points, in words."""
        if not self._counts:
            return {}
        points = {"points": f"{int(np.median(self._counts)):,} a cloud"}
        if self._low > self._high:
            return points
        low, high = np.degrees((self._low, self._high))
        text = f"{self._coverage_deg:.0f} degrees around with returns, {low:.0f} to {high:.0f} up"
        return {"field of view": text, **points}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._counts and np.median(self._counts) < MIN_POINTS:
            number = int(np.median(self._counts))
            found = f"a cloud has {number} measured points, a flow needs {MIN_POINTS} and more"
            yield Finding(_ASSUMPTION, Severity.ERROR, found, "Check the driver and the topic")
        if len(self._sectors) < _MIN_SWEEPS:
            return
        looks = np.array(self._sectors)
        least = np.maximum(np.minimum(looks[1:].sum(axis=1), looks[:-1].sum(axis=1)), 1)
        common = float(np.median((looks[1:] & looks[:-1]).sum(axis=1) / least))
        whole_deg = 360 * np.mean(looks.any(axis=0))
        if common < _MIN_COMMON and whole_deg > 1.5 * self._coverage_deg:
            yield Finding(
                _ASSUMPTION,
                Severity.INFO,
                f"a cloud covers {self._coverage_deg:.0f} degrees, {len(looks)} together "
                f"{whole_deg:.0f}: clouds are parts of a revolution",
                "They are put together, which costs the time of one part; set the driver to whole "
                "revolutions if it can",
            )

    @property
    def _coverage_deg(self) -> float:
        return float(360 / NUM_SECTORS * np.median([one.sum() for one in self._sectors]))
