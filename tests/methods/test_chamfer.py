# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""NSFP's loss, against brute force and by hand."""

from __future__ import annotations

import pytest
import torch

from mnsf_ros.methods.nsfp import ChamferDistance


def slow_chamfer(moved, points, truncation_m):
    squared = (moved[:, None] - points[None]).square().sum(dim=2)
    return sum(
        torch.where(smallest > truncation_m**2, 0.0, smallest).mean()
        for smallest in (squared.min(dim=1).values, squared.min(dim=0).values)
    )


@pytest.mark.parametrize("truncation_m", [0.7, 1.5, 100.0])
def test_same_as_brute_force_and_so_is_the_gradient(generator, device, truncation_m):
    points = (10 * torch.rand(80, 3, generator=generator)).to(device)
    moved = (10 * torch.rand(120, 3, generator=generator)).to(device).requires_grad_()
    loss = ChamferDistance(points, truncation_m)(moved)
    (gradient,) = torch.autograd.grad(loss, moved)
    expected = slow_chamfer(moved, points, truncation_m)
    (expected_gradient,) = torch.autograd.grad(expected, moved)
    torch.testing.assert_close(loss, expected)
    torch.testing.assert_close(gradient, expected_gradient)


def test_by_hand(device):
    points = torch.tensor([[0.0, 0, 0], [10.0, 0, 0], [20.0, 0, 0], [30.0, 0, 0]], device=device)
    moved = torch.tensor([[1.0, 0, 0], [10.0, 2.0, 0]], device=device)
    # To the points: 1 and 4. From them: 1, 4, and two that are 10 m and 20 m away.
    assert ChamferDistance(points, 5.0)(moved).item() == pytest.approx(5 / 2 + 5 / 4)
    assert ChamferDistance(points, 1.5)(moved).item() == pytest.approx(1 / 2 + 1 / 4)


@pytest.mark.parametrize(("distance_m", "counts"), [(2.0, True), (2.0001, False)])
def test_pair_exactly_as_far_apart_as_allowed_still_counts(distance_m, counts):
    loss = ChamferDistance(torch.zeros(1, 3), 2.0)(torch.tensor([[distance_m, 0.0, 0.0]]))
    assert (loss.item() > 0) is counts


def test_nothing_for_points_that_coincide(generator, device):
    points = torch.rand(50, 3, generator=generator).to(device)
    moved = points.flip(0).clone().requires_grad_()
    loss = ChamferDistance(points, 2.0)(moved)
    loss.backward()
    assert loss.item() == 0
    assert not moved.grad.any()


def test_position_that_is_no_number_gives_a_loss_that_is_none(device):
    moved = torch.tensor([[float("nan"), 0.0, 0.0], [1.0, 1.0, 1.0]], device=device)
    assert not ChamferDistance(torch.zeros(3, 3, device=device), 2.0)(moved).isfinite()
