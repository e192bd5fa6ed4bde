# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Networks and optimizers that one triplet hands to the next. Not in the paper."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import torch
from torch import nn

from mnsf_ros.core.compute_device import layer_precision
from mnsf_ros.core.flow_field import FlowField, StackedFields
from mnsf_ros.core.learner import Learner, adam
from mnsf_ros.core.temporal_fusion import fusion_network
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start, Stretch, SweepTriplet


@dataclass(frozen=True)
class Learners:
    """The networks of the method.

    Attributes:
        fields: The forward field and the backward fields: to t-1, t-2 ...
        fusion: The fusion of their flows.
        stack: The fields as one network, if they are to be fitted in the same steps.
    """

    fields: tuple[Learner, ...]
    fusion: Learner
    stack: Learner | None = None

    @classmethod
    def fresh(
        cls,
        settings: Settings,
        generator: torch.Generator,
        device: torch.device,
        num_fields: int = 2,
    ) -> Learners:
        """Networks with random weights."""
        stack, precision = None, layer_precision(settings.compute)
        if settings.optimization.joint:
            fields = _fields_with_one_optimizer(settings, generator, device, num_fields)
        else:
            networks = [
                FlowField(settings.field, generator, precision=precision).to(device)
                for _ in range(num_fields)
            ]
            if num_fields > 1 and (settings.optimization.stacked or device.type == "cuda"):
                stack = Learner.fresh(StackedFields(networks))
                stack.num_networks = num_fields
            fields = tuple(Learner.fresh(network) for network in networks)
        fusion = fusion_network(settings.fusion, generator, num_fields, precision)
        return cls(fields, Learner.fresh(fusion.to(device)), stack)


def _fields_with_one_optimizer(
    settings: Settings, generator: torch.Generator, device: torch.device, number: int
) -> tuple[Learner, ...]:
    """Fields that start from the same weights, as in the authors' code."""
    precision = layer_precision(settings.compute)
    first = FlowField(settings.field, generator, precision=precision).to(device)
    networks = nn.ModuleList([first, *(copy.deepcopy(first) for _ in range(number - 1))])
    optimizer = adam(networks.parameters())
    return tuple(Learner(network, optimizer) for network in networks)


class WarmStart:
    """Keeps the networks of the last triplet until they no longer fit."""

    def __init__(self) -> None:
        self._carried: Learners | None = None
        self._stretch: Stretch | None = None

    def keep(self, learners: Learners, triplet: SweepTriplet) -> None:
        """Carries the networks, fitted to this triplet, to the next one."""
        self._carried, self._stretch = learners, triplet.stretch

    def forget(self) -> None:
        """Makes the next start a cold one."""
        self._carried = None

    def carried(self, triplet: SweepTriplet, settings: Settings) -> tuple[Learners | None, Start]:
        """The networks to start this triplet from, or None and the reason for a cold start."""
        if not settings.warm_start.enabled:
            return None, Start.COLD_BY_SETTING
        if self._carried is None or triplet.stretch is not self._stretch:
            return None, triplet.stretch.start
        return self._carried, Start.WARM
