"""Fitting g_f toward the next sweep and g_b toward the previous one (section 3, steps 1 and 2)."""

from __future__ import annotations

import torch

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.optimization import Learner, OptimizationResult, minimize
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance


def fit_field(
    field: Learner, batches: Batches, target: TargetDistance, schedule: Schedule
) -> OptimizationResult:
    """Makes a field move the current points onto a target sweep: minimizes mean D(p + g(p), S).

    Args:
        field: The field to fit, in place.
        batches: Rows (M, 3): points of the current sweep, metres.
        target: Distance to the next or to the previous sweep.
        schedule: How long and with which steps.

    Raises:
        OptimizationError: If the loss is not finite.
        CancelledError: If the schedule says so.
    """

    def loss_of() -> torch.Tensor:
        points = batches.draw()
        return target.mean(points + field.network(points))

    return minimize(field, loss_of, schedule, keep_best=batches.are_whole)


@torch.no_grad()
def still_fits(
    field: Learner, batches: Batches, target: TargetDistance, max_loss_ratio: float
) -> bool:
    """Whether a field that was fitted to an earlier pair of sweeps explains this one, too.

    Args:
        field: The carried field.
        batches: Rows (M, 3): points of the current sweep, metres.
        target: Distance to the sweep that the field should move the points onto.
        max_loss_ratio: How much larger than at the end of its fit the loss may be.
    """
    if field.last_loss is None:
        return False
    points = batches.draw()
    loss = target.mean(points + field.network(points)).item()
    return loss <= max_loss_ratio * max(field.last_loss, _SMALLEST_LOSS_M)


# Below this the loss is noise of the sensor, and its ratio says nothing.
_SMALLEST_LOSS_M = 0.02
