# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: all clouds of a topic are of one lidar."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample

_ASSUMPTION: Final = "all clouds of a topic are of one lidar"
# So many lidars in turn are told.
_MOST: Final = 4
_NUM_BEFORE: Final = 100
_MIN_CLOUDS: Final = 16
# Views of a lidar become less alike with time. The difference from the view two to four clouds
# before was .93 times that from the last one and more in real recordings and simulated streams.
_ALIKE: Final = 0.7


class OneLidar(Assumption):
    """Compares the ranges on all sides with those one to four clouds before."""

    def __init__(self) -> None:
        self._views: deque[Floats] = deque(maxlen=_MOST)
        # Mean difference from the view one, two, three and four clouds before.
        self._differences: deque[Floats] = deque(maxlen=_NUM_BEFORE)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        if not sample.is_continued or sample.num_parts > 1:
            self._views.clear()
        if sample.num_parts > 1 or (glance := sample.glance) is None:
            return
        if len(self._views) == _MOST:
            differences = np.abs(np.array(self._views) - glance.log_by_side)
            # Clouds that are repeated are another fault.
            if (known := np.isfinite(differences).all(axis=0)).any() and differences.any(
                axis=1
            ).all():
                self._differences.append(differences[::-1, known].mean(axis=1))
        self._views.append(glance.log_by_side)

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if len(self._differences) < _MIN_CLOUDS:
            return
        last, *before = np.mean(self._differences, axis=0)
        likest = int(np.argmin(before))
        if before[likest] < _ALIKE * last:
            number = likest + 2
            found = (
                f"clouds show {number} views in turn: ranges differ by {np.expm1(last):.0%} from "
                f"the last one, by {np.expm1(before[likest]):.0%} from that {number} before"
            )
            remedy = (
                f"If {number} lidars publish on this topic, give each a topic and a frame_id of "
                "its own, and set lidars.count and their poses"
            )
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)
