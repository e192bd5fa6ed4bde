"""Scene flow of clouds in arrays: the whole method in one call, without ROS."""

from __future__ import annotations

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
    settings: Settings | None = None,
) -> FlowEstimate:
    """Estimates where each point of a sweep is one sweep later.

    Args:
        current: (N, 3) or wider, metres, finite: the sweep at t.
        next: (M, 3), the sweep at t+1, in its own sensor frame.
        previous: (L, 3), the sweep at t-1. Without it, two sweeps are used (FNSF).
        settings: How; the `paper` preset if not given.

    Returns:
        The flow (N, 3), metres: current + flow is the position at t+1. With timings and the
        reason why each optimization stopped.

    Raises:
        SweepError: If an array has the wrong shape or values, or too few points are left of it.
        SettingsError: If the settings ask for a device that is not there.
        OptimizationError: If the optimization finds no finite flow.
    """
    triplet = SweepTriplet(
        previous=None if previous is None else Sweep.from_array(previous, name="previous"),
        current=Sweep.from_array(current, name="current"),
        next=Sweep.from_array(next, name="next"),
    )
    settings = settings or preset("paper")
    return make_method(settings.method.name, settings).estimate(triplet)
