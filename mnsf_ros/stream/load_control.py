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
        # Numbers of estimates.
        self._since_change = self._since_drop = 0
        self._calm = _CALM
        self._is_on_trial = False

    def count_drop(self) -> None:
        """A triplet was dropped: less effort, unless it was changed just now."""
        with self._lock:
            self._since_drop = 0
            if self._since_change < _SETTLING or self.effort is Effort.LEAST:
                return
            if self._is_on_trial:
                self._calm = min(2 * self._calm, _CALMEST)
            self._change(self.effort + 1, is_on_trial=False)

    def count_estimate(self) -> None:
        """An estimate is done: more effort, after many in a row without a drop."""
        with self._lock:
            self._since_change += 1
            self._since_drop += 1
            if min(self._since_change, self._since_drop) < self._calm:
                return
            if self._is_on_trial:
                self._calm, self._is_on_trial = _CALM, False
            if self.effort is not Effort.FULL:
                self._change(self.effort - 1, is_on_trial=True)

    def _change(self, effort: int, *, is_on_trial: bool) -> None:
        self.effort, self._is_on_trial = Effort(effort), is_on_trial
        self._since_change = 0
