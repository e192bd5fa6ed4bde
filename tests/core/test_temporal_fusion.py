# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fusion of forward flow f and inverted backward flow f': mean, weighted sum, network."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from mnsf_ros.core.batches import Batches
from mnsf_ros.core.optimization import Learner, StopReason
from mnsf_ros.core.schedule import Schedule
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.core.temporal_fusion import (
    MeanFusion,
    MlpFusion,
    WeightedSumFusion,
    fit_fusion,
    fusion_network,
)
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings

KINDS = {"mean": MeanFusion, "weighted_sum": WeightedSumFusion, "mlp": MlpFusion}


def settings_of(kind):
    return Settings().changed({"fusion.kind": kind}).fusion


@pytest.fixture
def both_flows(generator):
    return torch.randn(50, 6, generator=generator)


@pytest.mark.parametrize("kind", KINDS)
def test_setting_chooses_the_kind(kind, both_flows, generator):
    network = fusion_network(settings_of(kind), generator)
    assert type(network) is KINDS[kind]
    assert network(both_flows).shape == (50, 3)


def test_mean_by_hand():
    both = torch.tensor([[1.0, 2.0, 3.0, 5.0, -2.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, -1.0]])
    assert MeanFusion()(both).tolist() == [[3.0, 0.0, 1.5], [0.0, 0.0, -0.5]]
    assert not list(MeanFusion().parameters())


def test_weighted_sum_starts_at_the_mean(both_flows):
    torch.testing.assert_close(WeightedSumFusion()(both_flows), MeanFusion()(both_flows))


def test_weighted_sum_by_hand():
    # W f + (I - W) f' with f = (1, 2, 3), f' = (1, 0, 0), so f - f' = (0, 2, 3).
    network = WeightedSumFusion()
    (weight,) = network.parameters()
    weight.data = torch.tensor([[1.0, 0.5, 0.0], [0.0, 2.0, 1.0], [0.0, 0.0, -1.0]])
    fused = network(torch.tensor([[1.0, 2.0, 3.0, 1.0, 0.0, 0.0]]))
    assert fused.tolist() == [[1 + 1.0, 4.0 + 3.0, -3.0]]


def test_weight_of_one_and_of_nothing(both_flows):
    network = WeightedSumFusion()
    (weight,) = network.parameters()
    weight.data = torch.eye(3)
    torch.testing.assert_close(network(both_flows), both_flows[:, :3])
    weight.data = torch.zeros(3, 3)
    torch.testing.assert_close(network(both_flows), both_flows[:, 3:])


def test_network_of_the_paper_sees_both_flows(generator):
    network = fusion_network(preset("paper").fusion, generator)
    layers = [layer for layer in network.modules() if isinstance(layer, nn.Linear)]
    assert [layer.in_features for layer in layers] == [6, 128, 128, 128]
    assert layers[-1].out_features == 3


@pytest.mark.parametrize("kind", KINDS)
def test_points_share_one_fusion(kind, both_flows, generator):
    network = fusion_network(settings_of(kind), generator)
    torch.testing.assert_close(network(both_flows)[9:11], network(both_flows[9:11]))


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
def test_weighted_sum_learns_whom_to_trust(device, batch_points):
    fit = Fit("weighted_sum", device, batch_points=batch_points)
    assert fit.start_loss > 0.1  # the mean is a quarter of a metre off
    assert fit.loss() < 0.01
    fused = fit.learner.network(fit.both_flows).detach()
    torch.testing.assert_close(fused, fit.both_flows[:, :3], atol=0.02, rtol=0)


def test_network_learns_more_than_the_mean_knows(device):
    assert Fit("mlp", device).result.loss_m < 0.5 * Fit("mean", device).result.loss_m


def test_loss_of_the_result_is_that_of_the_weights_left_behind(device):
    fit = Fit("mlp", device)
    assert fit.result.loss_m == pytest.approx(fit.loss(), rel=1e-5)


def test_mean_has_nothing_to_learn(device):
    fit = Fit("mean", device)
    assert fit.result.iterations == 0
    assert fit.result.stop_reason is StopReason.CONVERGED
    assert fit.result.loss_m == pytest.approx(fit.start_loss)
