# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: clouds follow each other within buffer.max_interval_s."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample
from mnsf_ros.settings import BufferSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS

_ASSUMPTION: Final = "clouds follow each other in time"
_MIN_INTERVALS: Final = 4
# A flow needs three clouds in a row: a tenth of long intervals costs two tenths of the flows.
_MAX_SHARE: Final = 0.1
# Nine of ten intervals, and a tenth more.
_MOST: Final = 0.9
_MORE: Final = 1.1
# Longer ones are better mended at the driver: a car passes three lengths in the meantime.
_LONGEST_S: Final = 2.0


class CloseClouds(Assumption):
    """Compares the intervals of stamps with the longest over which there is a flow."""

    def __init__(self, settings: BufferSettings) -> None:
        self._longest_s = settings.max_interval_s
        self._intervals_s: deque[float] = deque(maxlen=100)
        self._last_ns = 0

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        now_ns, last_ns = sample.sweep.stamp_ns, self._last_ns
        self._last_ns = now_ns
        if last_ns and now_ns > last_ns:
            self._intervals_s.append((now_ns - last_ns) / NANOSECONDS)

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        intervals_s = np.array(self._intervals_s)
        num_long = int(np.count_nonzero(intervals_s > self._longest_s))
        if len(intervals_s) < _MIN_INTERVALS or num_long <= _MAX_SHARE * len(intervals_s):
            return
        found = (
            f"{num_long} of {len(intervals_s)} intervals between clouds are longer than "
            f"{self._longest_s:g} s: there is no flow across them"
        )
        # Pauses between runs are no interval of the clouds.
        usual_s = float(np.quantile(intervals_s, _MOST))
        remedy = "Let the driver publish more often"
        if usual_s < _LONGEST_S:
            remedy = f"Set buffer.max_interval_s={np.ceil(10 * _MORE * usual_s) / 10:.1f}"
        yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)
