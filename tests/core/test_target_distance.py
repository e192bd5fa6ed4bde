# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S) against brute force: the distance transform, the search, and the choice between them."""

import math

import pytest
import torch

from mnsf_ros.core.target_distance import (
    DistanceTransform,
    NearestNeighborDistance,
    TargetDistance,
    nodes_around,
)
from mnsf_ros.settings import Settings

CELL_M = 0.5


def distance_to(points, **changes):
    settings = Settings().changed({f"distance.{name}": value for name, value in changes.items()})
    return TargetDistance.to_points(points, settings.distance)


def transform(points, cell_size_m=CELL_M):
    return DistanceTransform(points, cell_size_m)


def brute_force(positions, points):
    # Not torch.cdist: for many points it loses centimetres.
    return (positions[:, None] - points[None]).norm(dim=2).min(dim=1).values


@pytest.fixture
def points(generator, device):
    return (6 * torch.rand(60, 3, generator=generator) - torch.tensor([3.0, 1.0, 50.0])).to(device)


def anywhere(points, generator, beyond):
    """Positions in the box around the points and up to so many metres beyond it."""
    low, high = points.min(dim=0).values.cpu() - beyond, points.max(dim=0).values.cpu() + beyond
    return (low + (high - low) * torch.rand(2000, 3, generator=generator)).to(points.device)


# 0.5 is exact in binary, 0.1 is not.
@pytest.mark.parametrize("cell_size_m", [0.1, 0.5])
def test_exact_at_the_nodes(generator, device, cell_size_m):
    points = cell_size_m * torch.randint(-12, 13, (40, 3), generator=generator).to(device)
    axes = [
        cell_size_m * torch.arange(first, first + count)
        for first, count in zip(*nodes_around(points, cell_size_m), strict=True)
    ]
    nodes = torch.cartesian_prod(*axes).to(device)
    distances = transform(points, cell_size_m)(nodes)
    torch.testing.assert_close(distances, brute_force(nodes, points), atol=1e-4, rtol=1e-4)
    assert distances.max() > 4 * cell_size_m


@pytest.mark.parametrize("offset", [0.0, 900.0])
@pytest.mark.parametrize("cell_size_m", [0.1, 0.5])
def test_between_the_nodes_wrong_by_less_than_a_cell_and_a_half(
    points, generator, cell_size_m, offset
):
    # At most a diagonal from the nodes of a cell, half a diagonal from a point to its node.
    points = points + offset
    positions = anywhere(points, generator, beyond=0.0)
    error = transform(points, cell_size_m)(positions) - brute_force(positions, points)
    assert error.abs().max() < 1.5 * math.sqrt(3) * cell_size_m
    assert error.abs().mean() < 0.5 * cell_size_m


@pytest.mark.parametrize("beyond", [2.0, 30.0, 1e4])
def test_outside_it_is_not_too_small_and_pulls_back(points, generator, beyond):
    positions = anywhere(points, generator, beyond)
    distances = transform(points)
    excess = distances(positions) - brute_force(positions, points)
    assert (excess > -1.5 * math.sqrt(3) * CELL_M - 1e-6 * beyond).all()
    low, high = distances.low, distances.high
    positions = positions[((positions < low) | (positions > high)).any(dim=1)].requires_grad_()
    assert len(positions) > 100
    (pull,) = torch.autograd.grad(distances(positions).sum(), positions)
    assert pull.norm(dim=1).min() > 0.5
    with torch.no_grad():
        gap = (positions - positions.clamp(low, high)).norm(dim=1, keepdim=True)
        step = torch.minimum(gap, gap.new_tensor(0.5))
        closer = positions - pull / pull.norm(dim=1, keepdim=True) * step
        assert (distances(closer) < distances(positions)).all()


def test_search_is_the_same_as_brute_force(points, generator):
    positions = anywhere(points, generator, beyond=5.0).requires_grad_()
    distances = NearestNeighborDistance(points)(positions)
    torch.testing.assert_close(distances, brute_force(positions, points))
    (gradient,) = torch.autograd.grad(distances.sum(), positions)
    landed = positions.detach() - gradient * distances.detach()[:, None]
    assert brute_force(landed, points).max() < 1e-4


@pytest.mark.parametrize("lookup", [transform, NearestNeighborDistance])
def test_positions_that_are_points_far_away_or_no_numbers(points, lookup):
    target = lookup(points)
    far = points.new_tensor([[1e7, 0.0, -1e7], [1e20, 0.0, -1e20]])
    positions = torch.cat([points, far]).requires_grad_()
    distances = target(positions)
    distances.sum().backward()
    assert distances[: len(points)].max() < math.sqrt(3) * CELL_M
    assert (distances[len(points) :] >= far[:, 0]).all()
    assert positions.grad.isfinite().all()
    for bad in (math.nan, math.inf):
        assert not target(points.new_tensor([[bad, 0.0, 0.0]])).isfinite().any()


def test_setting_chooses_the_kind_but_a_grid_that_is_too_large_is_replaced(points):
    assert distance_to(points, kind="tree").kind == "tree"
    num_cells = math.prod(nodes_around(points, 0.1)[1])
    assert distance_to(points, kind="grid", max_cells=num_cells).kind == "grid"
    assert distance_to(points, kind="grid", max_cells=num_cells - 1).kind == "tree"
    # With 10 cells per metre and 10 m of height, 10 km need 10^9 cells and more.
    for far in (1e4, 1e20):
        target = distance_to(torch.cat([points, points.new_tensor([[far, far, 0.0]])]), kind="grid")
        assert target.kind == "tree"
        assert target(points).max() < 1e-6


@pytest.mark.parametrize("kind", ["grid", "tree"])
def test_truncation(device, kind):
    origin = torch.zeros(1, 3, device=device)
    target = distance_to(origin, kind=kind, truncation_m=2)
    positions = torch.zeros(4, 3, device=device)
    positions[:, 0] = torch.tensor([1.0, 3.0, 1e7, 1e20])
    distances = target(positions.requires_grad_())
    torch.testing.assert_close(distances.tolist(), [1.0, 2.0, 2.0, 2.0])
    # The mean is the loss of the paper.
    assert target.mean(positions).item() == pytest.approx(7 / 4)
    (pull,) = torch.autograd.grad(distances.sum(), positions)
    assert pull[0, 0].item() == pytest.approx(1.0, abs=1e-3)
    assert not pull[1:].any()
    far = torch.tensor([[300.0, 0.0, 0.0]], device=device)
    assert distance_to(origin, kind=kind, truncation_m=0)(far).item() == pytest.approx(300)
