# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How long something that may pass is told: in a recording to its end, live for a while."""

from typing import Final

# At 10 Hz ten seconds: somebody who looks at a robot that stopped still reads why.
LIVE_MEMORY: Final = 100


class Episodes:
    """Counts the clouds in which something is wrong.

    Attributes:
        num: Clouds so far.
        num_wrong: Those in which it was wrong; live, what is long over is forgotten.
        is_now: Whether it was wrong in the last one.
    """

    def __init__(self, memory: float) -> None:
        """Starts without clouds; what was wrong is told for `memory` clouds after it."""
        self.num, self.num_wrong, self.is_now = 0, 0, False
        self._memory, self._last = memory, 0

    def add(self, *, is_wrong: bool) -> None:
        """Takes the next cloud."""
        self.num, self.is_now = self.num + 1, is_wrong
        if is_wrong:
            self.num_wrong, self._last = self.num_wrong + 1, self.num
        elif self.num - self._last > self._memory:
            self.num_wrong = 0

    @property
    def text(self) -> str:
        """How many clouds, in words."""
        return f"in {self.num_wrong:,} of {self.num:,} clouds"
