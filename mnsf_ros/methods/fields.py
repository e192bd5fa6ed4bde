"""The two kinds of flow field that the compared methods fit: a perceptron, or a linear one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import nn

from mnsf_ros.core.flow_field import FlowField
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.methods.kronecker_field import KroneckerField

FieldMaker = Callable[[Workbench], nn.Module]


def perceptron_field(bench: Workbench) -> FlowField:
    """A fresh field of the paper."""
    return FlowField(bench.settings.field, bench.generator).to(bench.device)


def linear_field(bench: Workbench) -> KroneckerField:
    """A fresh linear field on a grid around the current and the next sweep.

    Raises:
        SweepError: If the grid would be too large.
    """
    points = torch.cat([bench.current.points, bench.next.points]).cpu()
    return KroneckerField(points, bench.settings.linear, bench.generator).to(bench.device)


def penalty(field: nn.Module, bench: Workbench) -> torch.Tensor | float:
    """What is added to the loss to keep the field smooth: nothing for a perceptron."""
    if isinstance(field, KroneckerField):
        return bench.settings.linear.variation_weight * field.total_variation()
    return 0.0


def schedule_for(field: nn.Module, schedule: Schedule, bench: Workbench) -> Schedule:
    """The schedule with the step size that suits the kind of field."""
    if isinstance(field, KroneckerField):
        return replace(schedule, learning_rate=bench.settings.linear.learning_rate)
    return schedule
