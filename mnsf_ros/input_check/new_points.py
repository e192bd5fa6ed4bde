# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: a cloud has no points of the cloud before it."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats32
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample
from mnsf_ros.sweeps.sweep import Sweep

_ASSUMPTION: Final = "a cloud has no points of the cloud before it"
# Of 512 points. A window of two sweeps shares half. Lidars with coarse ranges that stand share up
# to .45 (XT32M), with clouds long before, too: these are subtracted.
_MIN_SHARE: Final = 0.3
_MIN_CHECKS: Final = 3
# A driver does not begin with it later; a comparison takes some milliseconds.
_MAX_CHECKS: Final = 10
_ODD: Final = np.array((0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9), np.uint64)


class NewPoints(Assumption):
    """Looks for points of a cloud in the last one, and in one some clouds before."""

    def __init__(self) -> None:
        self._last: Sweep | None = None
        self._long_ago: Sweep | None = None
        self._shares: deque[tuple[float, float]] = deque(maxlen=_MAX_CHECKS)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        own, last = sample.sweep, self._last
        if len(self._shares) == _MAX_CHECKS:
            self._last = self._long_ago = None
            return
        self._last = own
        if not sample.is_due or not len(own):
            return
        if last is not None and self._long_ago is not None and last is not self._long_ago:
            self._shares.append((_share(own, last), _share(own, self._long_ago)))
        self._long_ago = own

    @property
    def num_sweeps(self) -> int:
        """Of how many sweeps a cloud has the points; 1 if of its own only."""
        if len(self._shares) < _MIN_CHECKS:
            return 1
        share, long_ago = np.median(self._shares, axis=0)
        return 1 if share - long_ago < _MIN_SHARE else round(1 / max(1 - share, 0.01))

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if (number := self.num_sweeps) > 1:
            found = (
                f"{np.median(self._shares, axis=0)[0]:.0%} of the points were in the cloud before: "
                f"a cloud has those of {number} sweeps"
            )
            remedy = (
                "Let the driver publish each point once: set its frame time, or the number of "
                "sweeps that it puts together, to one interval of its clouds. Other times of "
                "points do not mend it"
            )
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)


def _share(own: Sweep, other: Sweep) -> float:
    """Share of some points of a cloud that another has, too."""
    some = own.some_xyz[own.some_xyz.any(axis=1)]
    return float(np.isin(_keys(some), _keys(other.xyz)).mean()) if len(some) else 0.0


def _keys(xyz: Floats32) -> NDArray[np.uint64]:
    """(N,) one number for the coordinates of each point (N, 3)."""
    keys: NDArray[np.uint64] = (xyz.view(np.uint32) * _ODD).sum(axis=1, dtype=np.uint64)
    return keys
