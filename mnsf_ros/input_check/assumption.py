# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What all assumptions about the input have in common."""

from collections.abc import Iterator

from mnsf_ros.input_check.finding import Finding
from mnsf_ros.input_check.sweep_sample import Step, SweepSample


class Assumption:
    """Measures one assumption on a stream."""

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""

    def move(self, step: Step) -> None:
        """Takes the motion between two sweeps, after both."""

    @property
    def is_alarm(self) -> bool:
        """Whether it stopped to hold just now, which should be told at once."""
        return False

    def facts(self) -> dict[str, str]:
        """Name to what was measured, in words."""
        return {}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        yield from ()
