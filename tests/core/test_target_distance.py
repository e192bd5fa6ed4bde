# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S): which of the two ways computes it, and where it ends."""

from __future__ import annotations

import pytest
import torch

from mnsf_ros.core.distance_transform import GridBox
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.settings import Settings


def settings_with(**changes):
    return Settings().changed({f"distance.{name}": value for name, value in changes.items()})


def distance_to(points, **changes):
    return TargetDistance.to_points(points, settings_with(**changes).distance)


@pytest.fixture
def points(generator, device):
    return (10 * torch.rand(200, 3, generator=generator)).to(device)


@pytest.mark.parametrize("kind", ["grid", "tree"])
def test_setting_chooses_the_kind(points, kind):
    assert distance_to(points, kind=kind).kind == kind


@pytest.mark.parametrize("far", [1e4, 1e7, 1e20])
def test_stray_point_far_away_makes_no_grid(points, far):
    # With 10 cells per metre and 10 m of height, 10 km need 10^9 cells and more.
    stray = torch.tensor([[far, far, 0.0]], device=points.device)
    target = distance_to(torch.cat([points, stray]), kind="grid")
    assert target.kind == "tree"
    assert target(points).max() < 1e-6


def test_largest_grid_allowed(points):
    num_cells = GridBox.around(points, 0.1).num_cells
    assert distance_to(points, kind="grid", max_cells=num_cells).kind == "grid"
    assert distance_to(points, kind="grid", max_cells=num_cells - 1).kind == "tree"


def test_grid_and_tree_agree_to_a_cell(points, generator):
    positions = (14 * torch.rand(500, 3, generator=generator) - 2).to(points.device)
    grid, tree = (distance_to(points, kind=kind, truncation_m=0) for kind in ("grid", "tree"))
    is_inside = ((positions > 0) & (positions < 10)).all(dim=1)
    torch.testing.assert_close(
        grid(positions)[is_inside], tree(positions)[is_inside], atol=0.2, rtol=0
    )


@pytest.mark.parametrize("kind", ["grid", "tree"])
def test_truncation(device, kind):
    target = distance_to(torch.zeros(1, 3, device=device), kind=kind, truncation_m=2)
    positions = torch.tensor(
        [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1e7, 0.0, 0.0], [1e20, 0.0, 0.0]], device=device
    ).requires_grad_()
    distances = target(positions)
    torch.testing.assert_close(distances.cpu().detach(), torch.tensor([1.0, 2.0, 2.0, 2.0]))
    (pull,) = torch.autograd.grad(distances.sum(), positions)
    assert pull[0, 0].item() == pytest.approx(1.0, abs=1e-3)
    assert not pull[1:].any()


@pytest.mark.parametrize("kind", ["grid", "tree"])
def test_without_truncation(device, kind):
    target = distance_to(torch.zeros(1, 3, device=device), kind=kind, truncation_m=0)
    positions = torch.tensor([[300.0, 0.0, 0.0]], device=device)
    torch.testing.assert_close(target(positions).cpu(), torch.tensor([300.0]))


def test_mean_is_the_loss_of_the_paper(device):
    target = distance_to(torch.zeros(1, 3, device=device), kind="tree", truncation_m=2)
    # 0, 0.5 and 1 m, and one that counts as 2 m.
    positions = torch.tensor([[0.0, 0, 0], [0.5, 0, 0], [0, 0, -1.0], [0, 9, 0]], device=device)
    assert target.mean(positions).item() == pytest.approx(3.5 / 4)


def test_auto_takes_the_grid_on_cuda(points):
    expected = "grid" if points.is_cuda else "tree"
    assert distance_to(points, kind="auto").kind == expected


@pytest.mark.parametrize("kind", ["grid", "tree"])
def test_dead_zone_has_no_gradient(points, kind):
    target = distance_to(points, kind=kind, dead_zone_m=0.4, cell_size_m=0.1)
    positions = (points[:50] + 0.1).requires_grad_()
    distances = target(positions)
    assert (distances == 0.4).all()
    distances.sum().backward()
    assert not positions.grad.any()
    outside = points[:1] + torch.tensor([0.0, 0.0, 20.0], device=points.device)
    assert target(outside) == 2.0
