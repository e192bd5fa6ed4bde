# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The settings that reproduce what the authors' code does and the paper does not say."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from moving_sweeps import QUICK
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.flow_estimate import Start
from mnsf_ros.core.forward_backward_fields import fit_jointly
from mnsf_ros.core.optimization import Learner, PartlyJudgedLoss, StopReason, minimize
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.temporal_fusion import MlpFusion, WeightedSumFusion, fusion_network
from mnsf_ros.core.warm_start import Learners
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings


class Shift(nn.Module):
    """The same flow everywhere, three weights."""

    def __init__(self):
        super().__init__()
        self.shift = nn.Parameter(torch.zeros(3))

    def forward(self, positions):
        return self.shift.expand_as(positions)


class ToPlane:
    """Mean distance to the plane x = a."""

    def __init__(self, a):
        self.a = a

    def mean(self, positions):
        return (positions[:, 0] - self.a).abs().mean()


def joint_fields(number=2):
    networks = nn.ModuleList(Shift() for _ in range(number))
    optimizer = torch.optim.Adam(networks.parameters())
    return [Learner(network, optimizer) for network in networks]


def at_origin():
    return Batches(torch.zeros(4, 3), 0, torch.Generator())


def shifts(fields):
    return [round(field.network.shift[0].item(), 3) for field in fields]


@pytest.mark.parametrize(("near", "far"), [(0.2, 5.0), (-0.2, -5.0)])
def test_joint_fit_stops_as_soon_as_the_forward_loss_does(near, far):
    # Steps of 0.1: the forward field is there after two of them, the backward field still far.
    schedule = Schedule(200, 0.1, patience=5, min_delta_m=0.01)
    fields = joint_fields()
    result = fit_jointly(fields, at_origin(), [ToPlane(near), ToPlane(far)], schedule)
    assert result.stop_reason is StopReason.CONVERGED
    assert result.iterations < 15
    other_way = joint_fields()
    result = fit_jointly(other_way, at_origin(), [ToPlane(far), ToPlane(near)], schedule)
    assert result.iterations > 45
    assert abs(shifts(fields)[1]) < 1.6
    assert shifts(other_way)[0] == pytest.approx(far, abs=0.3)


def test_joint_fit_keeps_the_lowest_sum_or_the_last_step():
    schedule = Schedule(40, 0.9)
    kept, last = joint_fields(), joint_fields()
    targets = [ToPlane(1.0), ToPlane(-1.3)]
    best = fit_jointly(kept, at_origin(), targets, schedule, keep_best=True)
    end = fit_jointly(last, at_origin(), targets, schedule, keep_best=False)
    losses = [abs(shift - target) for shift, target in zip(shifts(kept), (1.0, -1.3), strict=True)]
    assert best.loss_m == pytest.approx(sum(losses), abs=2e-3)
    assert best.loss_m < end.loss_m
    assert [field.last_loss for field in kept] == pytest.approx(losses, abs=2e-3)


def test_one_optimizer_steps_as_two_would():
    # Adam looks at each weight by itself, so all that joins the fields is when they stop.
    fields, alone = joint_fields(), Learner.fresh(Shift())
    schedule = Schedule(30, 0.05)
    fit_jointly(fields, at_origin(), [ToPlane(1.0), ToPlane(-0.7)], schedule, keep_best=False)
    target = ToPlane(-0.7)
    minimize(
        alone, lambda: target.mean(alone.network(torch.zeros(4, 3))), schedule, keep_best=False
    )
    torch.testing.assert_close(fields[1].network.shift, alone.network.shift)


def test_partly_judged_loss_stops_by_the_part_and_keeps_the_best_sum():
    learner = Learner.fresh(Shift())
    constant = torch.tensor(1.0)

    def loss_of():
        return PartlyJudgedLoss((learner.network.shift - 10).square().sum(), constant)

    result = minimize(learner, loss_of, Schedule(100, 0.1, patience=7), keep_best=True)
    assert (result.iterations, result.stop_reason) == (8, StopReason.CONVERGED)
    assert result.loss_m == pytest.approx(3 * (10 - 0.7) ** 2, rel=1e-3)


def test_joint_fields_start_from_the_same_weights():
    settings = QUICK.changed({"optimization.joint": True})
    learners = Learners.fresh(settings, torch.Generator(), torch.device("cpu"), num_fields=3)
    first, *others = (field.network.state_dict() for field in learners.fields)
    for other in others:
        for name, weights in first.items():
            assert torch.equal(weights, other[name])
            assert weights.data_ptr() != other[name].data_ptr()
    assert len({id(field.optimizer) for field in learners.fields}) == 1


def test_joint_estimate(translated):
    result = make_method("mnsf", QUICK.changed({"optimization.joint": True})).estimate(translated)
    assert list(result.fits) == ["fields", "fusion"]
    assert list(result.times_ms) == ["prepare", "fields", "fusion"]
    truth = np.broadcast_to((0.3, -0.2, 0.05), result.flow.shape)
    assert np.linalg.norm(result.flow - truth, axis=1).mean() < 0.05


def test_joint_fields_go_on_warm_and_alone(translated):
    values = {"optimization.joint": True, "warm_start.enabled": True}
    joint = QUICK.changed({**values, "warm_start.max_loss_ratio": 1000})
    estimator = make_method("mnsf", joint)
    starts = [estimator.estimate(translated).start for _ in range(2)]
    assert starts == [Start.COLD_FIRST, Start.WARM]
    # Fields with an optimizer each are other networks.
    apart = estimator.with_settings(joint.changed({"optimization.joint": False}))
    assert apart.estimate(translated).start is Start.COLD_FIRST


def test_fields_of_the_last_step_are_fused(translated):
    # Steps far too large: the last weights are not the best.
    wild = QUICK.changed(
        {
            "fusion.kind": "mean",
            "optimization.learning_rate": 0.3,
            "optimization.decay": False,
            "optimization.max_iterations": 15,
        }
    )
    best, last = (
        make_method("mnsf", wild.changed({"fusion.fields": each})).estimate(translated)
        for each in ("best", "last")
    )
    assert not np.allclose(best.flow, last.flow)
    for stage in ("forward", "backward"):
        assert best.fits[stage].loss_m <= last.fits[stage].loss_m


def test_fusion_of_the_sum_cannot_tell_the_flows_apart(generator):
    settings = Settings().changed({"fusion.input": "sum"}).fusion
    network = fusion_network(settings, generator, num_flows=3)
    assert isinstance(network, MlpFusion)
    flows = torch.randn(20, 3, 3, generator=generator)
    swapped = flows[:, [2, 0, 1]]
    torch.testing.assert_close(network(flows.flatten(1)), network(swapped.flatten(1)))
    apart = fusion_network(Settings().fusion, generator, num_flows=3)
    assert not torch.allclose(apart(flows.flatten(1)), apart(swapped.flatten(1)))


@pytest.mark.parametrize("number", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", ["mlp", "mean", "weighted_sum"])
def test_any_number_of_flows_can_be_fused(generator, kind, number):
    settings = Settings().changed({"fusion.kind": kind}).fusion
    flows = torch.randn(20, number, 3, generator=generator)
    fused = fusion_network(settings, generator, number)(flows.flatten(1))
    assert fused.shape == (20, 3)
    if kind != "mlp":
        torch.testing.assert_close(fused, flows.mean(dim=1))


def test_weights_of_a_sum_of_three_add_up_to_one():
    network = WeightedSumFusion(3)
    (weights,) = network.parameters()
    weights.data = torch.cat([2 * torch.eye(3), 5 * torch.eye(3)], dim=1)
    fused = network(torch.tensor([[1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]]))
    assert fused.tolist() == [[2.0, 5.0, 1 - 2 - 5]]


def test_preset_of_the_authors_differs_from_the_paper_in_what_their_code_does():
    paper, authors = (preset(name).to_mapping() for name in ("paper", "authors"))
    assert {name: authors[name] for name in paper if paper[name] != authors[name]} == {
        "optimization.joint": True,
        "fusion.input": "sum",
        "fusion.fields": "last",
        "fusion.patience": 30,
        "nsfp.weight_decay": 0.0001,
        "nsfp.min_delta_m2": 0.0001,
    }
