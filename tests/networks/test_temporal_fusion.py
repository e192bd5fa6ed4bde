# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Inversion of the backward flow, and fusion of f and f': mean, weighted sum, network."""

import pytest
import torch

from mnsf_ros.core.flow_estimate import StopReason
from mnsf_ros.networks.networks import (
    MeanFusion,
    MlpFusion,
    WeightedSumFusion,
    fusion_network,
    invert_motion,
)
from mnsf_ros.networks.optimization import Schedule, minimize
from mnsf_ros.networks.target_distance import TargetDistance
from mnsf_ros.settings import Settings

KINDS = {"mean": MeanFusion, "weighted_sum": WeightedSumFusion, "mlp": MlpFusion}


def settings_of(kind):
    return Settings().changed({"fusion.kind": kind}).fusion


@pytest.fixture
def both_flows(generator):
    return torch.randn(50, 6, generator=generator)


def test_inversion_at_constant_velocity():
    # 10 m/s along x: 1 m back in 0.1 s, 3 m ahead in 0.3 s.
    backward = torch.tensor([[-1.0, 0.0, 0.0]])
    torch.testing.assert_close(invert_motion(backward, 0.3 / 0.1), torch.tensor([[3.0, 0.0, 0.0]]))


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


@pytest.mark.parametrize("kind", KINDS)
def test_fusion_is_fitted_where_it_has_weights(device, generator, kind):
    """f is the true flow and f' is half a metre off: the mean is a quarter of a metre off."""
    points = 5 * torch.rand(200, 3, generator=generator)
    flow = torch.rand(200, 3, generator=generator) - 0.5
    flows = torch.cat([flow, flow + torch.tensor([0.5, 0.0, 0.0])], dim=1).to(device)
    target = TargetDistance((points + flow).to(device), Settings().distance)
    network = fusion_network(settings_of(kind), generator).to(device)
    points, schedule = points.to(device), Schedule(300, 0.02, True)
    result = minimize(network, lambda: target.mean(points + network(flows)), schedule)
    fused = network(flows).detach()
    loss_m = target.mean(points + fused).item()
    if kind == "mean":
        assert (result.iterations, result.stop_reason) == (0, StopReason.CONVERGED)
        assert loss_m > 0.1
    elif kind == "mlp":
        assert loss_m < 0.05
        assert result.loss_m == pytest.approx(loss_m, rel=1e-5)
    else:
        torch.testing.assert_close(fused, flows[:, :3], atol=0.02, rtol=0)
