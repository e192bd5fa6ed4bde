# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""MNSF, the method of the paper: from three sweeps to the flow of the middle one.

`mnsf` follows section 3 step by step. Variants (ablations, more sweeps, the authors' code) are
settings and the number of fields; `mnsf_cycle` has another loss.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import nn

from mnsf_ros.networks.networks import Perceptron, invert_motion
from mnsf_ros.networks.optimization import Schedule
from mnsf_ros.networks.workbench import PreparedSweep, Workbench


def mnsf(bench: Workbench, num_fields: int = 2) -> torch.Tensor:
    """MNSF (section 3 of the paper); (N, 3) metres.

    With fewer sweeps before the current one than backward fields, the forward flow alone is the
    result, which is FNSF.

    Args:
        bench: The sweeps.
        num_fields: The forward field, and a backward field for each sweep before the current one.
    """
    return fitted_mnsf(bench, num_fields)[0]


@dataclass(frozen=True)
class Networks:
    """The networks of the method."""

    fields: tuple[Perceptron, ...]  # the forward field and the backward fields: to t-1, t-2 ...
    fusion: nn.Module  # of their flows

    @classmethod
    def fresh(cls, bench: Workbench, num_fields: int) -> "Networks":
        """Networks with random weights; fields that are fitted jointly have the same."""
        if bench.settings.optimization.joint:
            first = bench.fresh_field()
            fields = (first, *(copy.deepcopy(first) for _ in range(num_fields - 1)))
        else:
            fields = tuple(bench.fresh_field() for _ in range(num_fields))
        return cls(fields, bench.fresh_fusion(num_fields))


def fitted_mnsf(bench: Workbench, num_fields: int = 2) -> tuple[torch.Tensor, Networks]:
    """The same, and the fitted networks."""
    with bench.stage("prepare"):
        networks = Networks.fresh(bench, num_fields)
    if len(bench.before) < num_fields - 1:
        one = bench.field_schedules(2)[:1]
        return _fitted_flows(bench, networks, one)[0], networks
    # 1. and 2.: the forward field and the backward field, each fitted to its sweep.
    forward_flow, *backward_flows = _field_flows(bench, networks)
    # 3.: the backward flow is inverted.
    inverted_flows = _inverted(bench, backward_flows)
    # 4.: the fusion makes one flow of both.
    flow = bench.fused_flow(networks.fusion, [forward_flow, *inverted_flows])
    return flow, networks


def _field_flows(bench: Workbench, networks: Networks) -> list[torch.Tensor]:
    """The flows to t+1, t-1, t-2 ..., (N, 3) metres each."""
    fields, is_joint = networks.fields, bench.settings.optimization.joint
    keep_best = bench.settings.fusion.fields == "best"
    number = 1 if is_joint else len(fields)
    schedules = [replace(one, keep_best=keep_best) for one in bench.field_schedules(number)]
    if not is_joint:
        return _fitted_flows(bench, networks, schedules)

    def loss_of() -> tuple[torch.Tensor, torch.Tensor]:
        """The sum, as in the authors' code; the first field alone tells whether it still falls."""
        pairs = zip(fields, (bench.next, *bench.before), strict=True)
        losses = [_loss(bench, field, target) for field, target in pairs]
        return torch.stack(losses).sum(), losses[0]

    bench.fit("fields", nn.ModuleList(fields), loss_of, schedules[0])
    return [bench.flow("fields", field) for field in fields]


def _loss(bench: Workbench, field: nn.Module, target: PreparedSweep) -> torch.Tensor:
    """Mean D(p + g(p), S): the field moves the points onto a target."""
    return target.distance.mean(bench.points + field(bench.points))


def _fitted_flows(
    bench: Workbench, networks: Networks, schedules: Sequence[Schedule]
) -> list[torch.Tensor]:
    """The flows of as many fields as there are schedules, each fitted by itself."""
    flows = []
    stages = ("forward", "backward", *(f"backward {k}" for k in range(2, len(schedules))))
    targets = (bench.next, *bench.before)
    for stage, field, target, schedule in zip(
        stages, networks.fields, targets, schedules, strict=False
    ):
        loss_of = partial(_loss, bench, field, target)
        bench.fit(stage, field, loss_of, schedule)
        flows.append(bench.flow(stage, field))
    return flows


def _inverted(bench: Workbench, backward_flows: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    """Flows to t-1, t-2 ... inverted into flows to t+1, unless `fusion.inversion` is off."""
    if not bench.settings.fusion.inversion:
        return list(backward_flows)
    ratios = bench.triplet.interval_ratios[: len(backward_flows)]
    return [invert_motion(flow, ratio) for flow, ratio in zip(backward_flows, ratios, strict=True)]


def mnsf_cycle(bench: Workbench) -> torch.Tensor:
    """MNSF (cycle consistency) of the paper's tables, with NSFP's cycle term; (N, 3) metres."""
    (previous,) = bench.before
    first, second = bench.field_schedules(2)
    forward_flow = _cycle_flow("forward", bench, bench.next, first)
    backward_flow = _cycle_flow("backward", bench, previous, second)
    inverted_flow = invert_motion(backward_flow, bench.triplet.interval_ratio)
    return bench.fused_flow(bench.fresh_fusion(), [forward_flow, inverted_flow])


def _cycle_flow(
    stage: str, bench: Workbench, target: PreparedSweep, schedule: Schedule
) -> torch.Tensor:
    """Minimizes mean D(q, S) + w mean D(q + h(q), S2), with q = p + g(p); (N, 3) metres."""
    weight = bench.settings.mnsf_cycle.weight
    there, back = (bench.fresh_field() for _ in range(2))

    def loss_of() -> torch.Tensor:
        points = bench.points
        moved = points + there(points)
        returned = moved + back(moved)
        return target.distance.mean(moved) + weight * bench.current.distance.mean(returned)

    bench.fit(stage, nn.ModuleList([there, back]), loss_of, schedule)
    return bench.flow(stage, there)
