"""What libraries and devices do only once must not be counted as time of the first estimate."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import numpy as np

from mnsf_ros.errors import MnsfError
from mnsf_ros.methods import make_method
from mnsf_ros.methods.command_estimator import CommandEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_FEW_STEPS: Final = {
    "optimization.max_iterations": 2,
    "fusion.max_iterations": 2,
    "warm_start.enabled": False,
    # The points below are near.
    "crop.min_range_m": 0.0,
}


def warm_up(method: str, settings: Settings) -> None:
    """Lets a method estimate a small triplet once; nothing of it is kept.

    Args:
        method: Name of the method. Other programs are left alone: they start for every example.
        settings: How it will estimate.

    Raises:
        SettingsError: There is no such method, or the settings do not suit it.
    """
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (256, 3)).astype(np.float32)
    sweeps = [Sweep(points, stamp_ns=number * 100_000_000) for number in range(5)]
    triplet = SweepTriplet(
        previous=sweeps[2],
        current=sweeps[3],
        next=sweeps[4],
        earlier=(sweeps[1], sweeps[0]),
        next_from_current=np.eye(4),
    )
    estimator = make_method(method, settings.changed(_FEW_STEPS))
    if isinstance(estimator, CommandEstimator):
        return
    with suppress(MnsfError):
        estimator.estimate(triplet)
