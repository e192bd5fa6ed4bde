# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: a cloud is one revolution, or the whole view of a lidar that does not turn."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import NUM_SECTORS, SweepSample
from mnsf_ros.sweeps.kept_points import MIN_POINTS

_ASSUMPTION: Final = "a cloud is one revolution"
_NUM_CLOUDS: Final = 60


class Revolution(Assumption):
    """Describes the directions of clouds, and of how many a revolution was put together."""

    def __init__(self) -> None:
        self._sectors: deque[int] = deque(maxlen=_NUM_CLOUDS)
        self._counts: deque[int] = deque(maxlen=_NUM_CLOUDS)
        self._parts: deque[int] = deque(maxlen=_NUM_CLOUDS)
        self._lows: deque[float] = deque(maxlen=_NUM_CLOUDS)
        self._highs: deque[float] = deque(maxlen=_NUM_CLOUDS)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        self._counts.append(len(sample.sweep))
        self._parts.append(sample.num_parts)
        if sample.is_due and len(sample.xyz):
            self._sectors.append(np.count_nonzero(sample.sectors))
            low, high = np.quantile(sample.elevations, (0.002, 0.998))
            self._lows.append(low)
            self._highs.append(high)

    def facts(self) -> dict[str, str]:
        """View and number of points, in words."""
        if not self._counts:
            return {}
        points = {"points": f"{int(np.median(self._counts)):,} a cloud"}
        if not self._lows:
            return points
        low, high = np.degrees((min(self._lows), max(self._highs)))
        around = f"{self._coverage_deg:.0f} degrees around with returns"
        return {"field of view": f"{around}, {low:.0f} to {high:.0f} degrees up", **points}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._counts and np.median(self._counts) < MIN_POINTS:
            number = int(np.median(self._counts))
            found = f"a cloud has {number} measured points, a flow needs {MIN_POINTS} and more"
            yield Finding(_ASSUMPTION, Severity.ERROR, found, "Check the driver and the topic")
        if self._parts and (num_parts := int(np.median(self._parts))) > 1:
            yield Finding(
                _ASSUMPTION,
                Severity.INFO,
                f"clouds of {self._coverage_deg:.0f} degrees are parts of a revolution: "
                f"{num_parts} are put together",
                "Nothing needs doing; whole revolutions from the driver save the delay of one part",
            )

    @property
    def _coverage_deg(self) -> float:
        return float(360 / NUM_SECTORS * np.median(self._sectors))
