# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Distance to the nearest point, against brute force."""

from __future__ import annotations

import math

import pytest
import torch

from mnsf_ros.core.target_distance import NearestNeighborDistance


def brute_force(positions, points):
    # Not torch.cdist: for many points it loses centimetres.
    return (positions[:, None] - points[None]).norm(dim=2).min(dim=1).values


@pytest.fixture
def points(generator, device):
    return (10 * torch.rand(300, 3, generator=generator)).to(device)


@pytest.fixture
def positions(generator, device):
    return (20 * torch.rand(500, 3, generator=generator) - 5).to(device)


def test_same_as_brute_force(points, positions):
    torch.testing.assert_close(
        NearestNeighborDistance(points)(positions), brute_force(positions, points)
    )


def test_no_distance_at_the_points_themselves(points):
    assert not NearestNeighborDistance(points)(points).any()


def test_gradient_points_away_from_the_nearest_point(points, positions):
    positions = positions.requires_grad_()
    distances = NearestNeighborDistance(points)(positions)
    (gradient,) = torch.autograd.grad(distances.sum(), positions)
    landed = positions.detach() - gradient * distances.detach()[:, None]
    assert brute_force(landed, points).max() < 1e-5


def test_no_gradient_at_a_point_is_no_nan(points):
    positions = points.clone().requires_grad_()
    NearestNeighborDistance(points)(positions).sum().backward()
    assert not positions.grad.any()


def test_single_point(device):
    target = NearestNeighborDistance(torch.zeros(1, 3, device=device))
    assert target(torch.tensor([[3.0, 0.0, 4.0]], device=device)).tolist() == [5.0]


@pytest.mark.parametrize("far", [1e7, 1e20, 3e38])
def test_far_away_is_no_nan(points, far):
    position = torch.tensor([[far, 0.0, -far]], device=points.device, requires_grad=True)
    distance = NearestNeighborDistance(points)(position)
    distance.sum().backward()
    assert distance.item() >= far
    assert position.grad.isfinite().all()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_position_that_is_no_number_has_a_distance_that_is_none(points, bad):
    positions = torch.tensor([[bad, 0.0, 0.0], [1.0, 1.0, 1.0]], device=points.device)
    distances = NearestNeighborDistance(points)(positions)
    assert distances.isfinite().tolist() == [False, True]
