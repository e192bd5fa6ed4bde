# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Inversion of the backward flow, and fusion of f and f': mean, weighted sum, network."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.flow_estimate import StopReason
from mnsf_ros.core.learner import Learner
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.core.temporal_fusion import (
    MeanFusion,
    MlpFusion,
    WeightedSumFusion,
    fit_fusion,
    fusion_network,
    invert_motion,
)
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings

KINDS = {"mean": MeanFusion, "weighted_sum": WeightedSumFusion, "mlp": MlpFusion}


def settings_of(kind):
    return Settings().changed({"fusion.kind": kind}).fusion


@pytest.fixture
def both_flows(generator):
    return torch.randn(50, 6, generator=generator)


@pytest.mark.parametrize("ratio", [1.0, 0.5, 4.0])
def test_inversion_there_and_back_is_identity(both_flows, ratio):
    flow = both_flows[:, :3]
    assert torch.equal(invert_motion(invert_motion(flow, ratio), 1 / ratio), flow)


def test_inversion_at_constant_velocity():
    # 10 m/s along x: 1 m back in 0.1 s, 3 m ahead in 0.3 s.
    backward = torch.tensor([[-1.0, 0.0, 0.0]])
    torch.testing.assert_close(invert_motion(backward, 0.3 / 0.1), torch.tensor([[3.0, 0.0, 0.0]]))


@pytest.mark.parametrize("kind", KINDS)
def test_setting_chooses_the_kind_and_points_share_one_fusion(kind, both_flows, generator):
    network = fusion_network(settings_of(kind), generator)
    assert type(network) is KINDS[kind]
    assert network(both_flows).shape == (50, 3)
    torch.testing.assert_close(network(both_flows)[9:11], network(both_flows[9:11]))


def test_mean_by_hand():
    both = torch.tensor([[1.0, 2.0, 3.0, 5.0, -2.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, -1.0]])
    assert MeanFusion()(both).tolist() == [[3.0, 0.0, 1.5], [0.0, 0.0, -0.5]]


def test_weighted_sum_starts_at_the_mean_and_by_hand(both_flows):
    network = WeightedSumFusion()
    torch.testing.assert_close(network(both_flows), MeanFusion()(both_flows))
    # W f + (I - W) f' with f = (1, 2, 3), f' = (1, 0, 0), so f - f' = (0, 2, 3).
    (weight,) = network.parameters()
    weight.data = torch.tensor([[1.0, 0.5, 0.0], [0.0, 2.0, 1.0], [0.0, 0.0, -1.0]])
    fused = network(torch.tensor([[1.0, 2.0, 3.0, 1.0, 0.0, 0.0]]))
    assert fused.tolist() == [[1 + 1.0, 4.0 + 3.0, -3.0]]


def test_network_of_the_paper_sees_both_flows(generator):
    network = fusion_network(preset("paper").fusion, generator)
    layers = [layer for layer in network.modules() if isinstance(layer, nn.Linear)]
    assert [layer.in_features for layer in layers] == [6, 128, 128, 128]
    assert layers[-1].out_features == 3


class Fit:
    """A fusion fitted where f is the true flow and f' is half a metre off."""

    def __init__(self, kind, device, *, batch_points=0):
        generator = torch.Generator().manual_seed(0)
        points = 5 * torch.rand(200, 3, generator=generator)
        flow = torch.rand(200, 3, generator=generator) - 0.5
        self.both_flows = torch.cat([flow, flow + torch.tensor([0.5, 0.0, 0.0])], 1).to(device)
        self.target = TargetDistance.to_points((points + flow).to(device), Settings().distance)
        self.learner = Learner.fresh(fusion_network(settings_of(kind), generator).to(device))
        self._points = points.to(device)
        rows = torch.cat([self._points, self.both_flows], dim=1)
        batches = Batches(rows, batch_points, generator)
        self.start_loss = self.loss()
        self.result = fit_fusion(self.learner, batches, self.target, Schedule(300, 0.02, True))

    @torch.no_grad()
    def loss(self):
        fused = self.learner.network(self.both_flows)
        return self.target.mean(self._points + fused).item()


@pytest.mark.parametrize("batch_points", [0, 50])
def test_weighted_sum_learns_the_better_flow(device, batch_points):
    fit = Fit("weighted_sum", device, batch_points=batch_points)
    assert fit.start_loss > 0.1  # the mean is a quarter of a metre off
    assert fit.loss() < 0.01
    fused = fit.learner.network(fit.both_flows).detach()
    torch.testing.assert_close(fused, fit.both_flows[:, :3], atol=0.02, rtol=0)


def test_network_learns_more_than_the_mean_knows(device):
    learned, mean = Fit("mlp", device), Fit("mean", device)
    assert learned.result.loss_m < 0.5 * mean.result.loss_m
    assert learned.result.loss_m == pytest.approx(learned.loss(), rel=1e-5)
    assert (mean.result.iterations, mean.result.stop_reason) == (0, StopReason.CONVERGED)
