# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the robot itself is not in the clouds, as the method sees it."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step

_ASSUMPTION: Final = "the robot itself is not in the clouds"
# Methods look for it within 2 m; what reaches so far may go on.
_END_M: Final = 1.8
# The rails on the roof of KITTI's car, .03 %, do no harm.
_MIN_SHARE: Final = 0.001


class RobotInView(Assumption):
    """Says what the method leaves out as the own body."""

    def __init__(self, *, is_searched: bool) -> None:
        self._is_searched = is_searched
        self._number, self._share, self._reach_m = 0, 0.0, 0.0

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        own = step.after.own_body
        self._number = len(own)
        self._reach_m = float(np.linalg.norm(own, axis=1).max(initial=0.0))
        self._share = self._number / max(len(step.after.sweep), 1)

    def facts(self) -> dict[str, str]:
        """Its points, in words."""
        if not self._number:
            return {"own body": "none"}
        return {"own body": f"{self._number:,} points within {self._reach_m:.1f} m, left out"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._is_searched and self._reach_m > _END_M:
            found = (
                f"own body: {self._number:,} points within {self._reach_m:.1f} m move along with "
                "the sensor; farther out it is not searched"
            )
            remedy = "If it reaches farther out, leave that out by boxes: crop.own_body"
            severity = Severity.WARNING if self._share > _MIN_SHARE else Severity.INFO
            yield Finding(_ASSUMPTION, severity, found, remedy)
