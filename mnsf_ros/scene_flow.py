# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scene flow of clouds in arrays: the whole method in one call, without ROS."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from numpy.typing import ArrayLike

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import never
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_REPORT_EVERY_S: Final = 2.0


def estimate_flow(
    current: ArrayLike,
    next: ArrayLike,  # noqa: A002 - the project's word for the sweep at t+1
    previous: ArrayLike | None = None,
    settings: Settings | str = "online",
    progress: Callable[[str], None] | None = None,
) -> FlowEstimate:
    """Estimates the flow of a sweep: the motion of each point until the next sweep.

    Args:
        current: (N, 3) or wider, metres, finite: the sweep at t.
        next: (M, 3), the sweep at t+1, in its own sensor frame.
        previous: (L, 3), the sweep at t-1. Without it, two sweeps are used.
        settings: Settings, or the name of a preset: `online`, the fast one; `paper`, the networks
            of the paper.
        progress: Gets a line of text every two seconds of an estimate that takes long, for
            example `print`.

    Returns:
        The flow (N, 3), metres: current + flow is the position at t+1. With timings, and by
        `online` with what moves, see `FlowEstimate.over_ground`.

    Raises:
        SweepError: If an array has the wrong shape or values, or too few points are left of it.
        SettingsError: If there is no such preset, or the settings ask for a device that is not
            there.
        OptimizationError: If the optimization finds no finite flow.
    """
    triplet = SweepTriplet(
        previous=None if previous is None else Sweep.from_array(previous, name="previous"),
        current=Sweep.from_array(current, name="current"),
        next=Sweep.from_array(next, name="next"),
    )
    if isinstance(settings, str):
        settings = preset(settings)
    method = make_method(settings.method.name, settings)
    return method.estimate(triplet, never if progress is None else StepReport(progress))


class StepReport:
    """A `cancelled` that never cancels, and reports the progress of the estimate."""

    def __init__(
        self, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Starts the clock; `say` gets a line of text now and then."""
        self._say = say
        self._clock = clock
        self._start_s = clock()
        self._due_s = self._start_s + _REPORT_EVERY_S
        self._num_steps = 0

    def __call__(self) -> bool:
        """Counts a step and returns False."""
        self._num_steps += 1
        now_s = self._clock()
        if now_s >= self._due_s:
            self._due_s = now_s + _REPORT_EVERY_S
            self._say(f"estimating: step {self._num_steps:,}, {now_s - self._start_s:.0f} s")
        return False
