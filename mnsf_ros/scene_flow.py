# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scene flow of clouds in arrays: the whole method in one call, without ROS."""

from numpy.typing import ArrayLike

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet


def estimate_flow(
    current: ArrayLike,
    next: ArrayLike,  # noqa: A002 - the project's word for the sweep at t+1
    previous: ArrayLike | None = None,
    settings: Settings | str = "online",
) -> FlowEstimate:
    """Estimates the flow of a sweep: the motion of each point until the next sweep.

    Args:
        current: (N, 3) or wider, metres, finite: the sweep at t.
        next: (M, 3), the sweep at t+1, in its own sensor frame.
        previous: (L, 3), the sweep at t-1. Without it, two sweeps are used.
        settings: Settings, or the name of a preset: `online`, the fast one; `paper`, the networks
            of the paper.

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
    return method.estimate(triplet)
