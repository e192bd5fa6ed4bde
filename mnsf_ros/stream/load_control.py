# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How much estimates do: less while triplets are dropped, all of it again when that has passed."""

import threading
from typing import Final

from mnsf_ros.core.flow_estimate import Effort

# Estimates until a change shows in the queues.
_SETTLING: Final = 5
# Estimates without a drop after which more is tried: 5 s at 10 Hz. Where that leads to a drop, the
# next try takes twice as long, up to 80 s: each costs a triplet or two.
_CALM: Final = 50
_CALMEST: Final = 800


class LoadControl:
    """Counts estimates and dropped triplets. For several threads.

    Attributes:
        effort: Of the next estimate.
    """

    def __init__(self) -> None:
        self.effort = Effort.FULL
        self._lock = threading.Lock()
        self._num_estimates = 0  # since the last change or drop
        self._calm = _CALM
        self._is_on_trial = False

    def count_drop(self) -> None:
        """A triplet was dropped: less effort, unless that was lowered just now."""
        with self._lock:
            has_settled, self._num_estimates = self._num_estimates >= _SETTLING, 0
            if not has_settled or self.effort is Effort.LEAST:
                return
            if self._is_on_trial:
                self._calm = min(2 * self._calm, _CALMEST)
            self.effort, self._is_on_trial = Effort(self.effort + 1), False

    def count_estimate(self) -> None:
        """An estimate is done: more effort, after many in a row without a drop."""
        with self._lock:
            self._num_estimates += 1
            if self._num_estimates < self._calm:
                return
            if self._is_on_trial or self.effort is Effort.FULL:
                self._calm = _CALM
            self._is_on_trial = self.effort is not Effort.FULL
            self.effort = Effort(max(self.effort - 1, Effort.FULL))
            self._num_estimates = 0
