# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rays without a return: left out when a cloud is read, and counted here."""

from collections import deque
from collections.abc import Iterator

import numpy as np

from mnsf_ros.input_check.finding import Finding
from mnsf_ros.input_check.sweep_sample import Step, SweepSample


class NoReturns:
    """Counts the points of the messages that are not in the sweeps."""

    def __init__(self) -> None:
        self._lost: deque[float] = deque(maxlen=100)

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        if sample.cloud is not None:
            self._lost.append(1 - len(sample.sweep) / max(len(sample.cloud.measured), 1))

    def move(self, step: Step) -> None:
        """They are seen without motion."""

    def facts(self) -> dict[str, str]:
        """Their share, in words."""
        if not self._lost:
            return {}
        return {"no returns": f"{np.median(self._lost):.1%} of the points, left out"}

    def findings(self) -> Iterator[Finding]:
        """Yields nothing: they do no harm."""
        yield from ()
