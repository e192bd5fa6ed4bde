# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""D(p, S) against brute force: the distance transforms, the searches, the choice between them."""

import math

import pytest
import torch

from mnsf_ros.networks import brick_distance
from mnsf_ros.networks.brick_distance import BrickDistance
from mnsf_ros.networks.cell_search import CellSearch
from mnsf_ros.networks.distance_transform import DistanceTransform, nodes_around
from mnsf_ros.networks.target_distance import NearestNeighborDistance, TargetDistance
from mnsf_ros.settings import Settings

CELL_M = 0.5
REACH_M = 2.0


def distance_to(points, **changes):
    settings = Settings().changed({f"distance.{name}": value for name, value in changes.items()})
    return TargetDistance(points, settings.distance)


def transform(points, cell_size_m=CELL_M):
    return DistanceTransform(points, cell_size_m)


def in_bricks(points, cell_size_m=CELL_M, reach_m=REACH_M):
    return BrickDistance(points, cell_size_m, reach_m, max_cells=50_000_000)


def in_cells(points, reach_m=REACH_M):
    if points.is_cuda:
        pytest.skip("the search in cells is one of the CPU")
    return CellSearch(points, reach_m)


def nodes_of_grid(points, cell_size_m):
    """The nodes around points, (nx ny nz, 3) float64 metres."""
    axes = [
        cell_size_m * torch.arange(first, first + count, dtype=torch.float64)
        for first, count in zip(*nodes_around(points, cell_size_m), strict=True)
    ]
    return torch.cartesian_prod(*axes).to(points.device)


def pull_of(target, positions):
    positions = positions.clone().requires_grad_()
    return torch.autograd.grad(target(positions).sum(), positions)[0]


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
    nodes = nodes_of_grid(points, cell_size_m).float()
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


# At 900 m float32 has 6e-5 m between numbers. With 1.35 m distances spread just one brick far.
@pytest.mark.parametrize("offset", [0.0, 900.0])
@pytest.mark.parametrize(("cell_size_m", "reach_m"), [(0.1, 2.0), (0.1, 1.35), (0.5, 2.0)])
def test_bricks_are_the_grid_up_to_their_reach(points, generator, cell_size_m, reach_m, offset):
    points = points + offset
    grid, bricks = transform(points, cell_size_m), in_bricks(points, cell_size_m, reach_m)
    expected = grid.distances.view(-1).clamp(max=reach_m)
    at_nodes = bricks(nodes_of_grid(points, cell_size_m))
    torch.testing.assert_close(at_nodes, expected, atol=1e-5, rtol=0)
    assert (expected < reach_m).sum() > 1000
    assert (expected == reach_m).any()
    positions = anywhere(points, generator, beyond=0.0)

    def clamped(positions):
        return grid(positions).clamp(max=reach_m)

    far_off = {"atol": 5e-4 if offset else 2e-5, "rtol": 0}
    torch.testing.assert_close(bricks(positions), clamped(positions), **far_off)
    pull = pull_of(bricks, positions)
    assert ((pull - pull_of(clamped, positions)).abs().amax(dim=1) > 0.01).float().mean() < 0.01
    outside = anywhere(points, generator, beyond=4 * reach_m)
    expected = brute_force(outside, points).clamp(max=reach_m)
    torch.testing.assert_close(bricks(outside), expected, atol=2.6 * cell_size_m, rtol=0)


@pytest.mark.slow
def test_bricks_of_a_long_reach(generator, device):
    # More than 127 cells: squares are no int16.
    bricks = in_bricks(torch.zeros(1, 3, device=device), 0.1, reach_m=13.0)
    nodes = 0.1 * torch.randint(-150, 151, (2000, 3), generator=generator).double().to(device)
    expected = nodes.norm(dim=1).clamp(max=13.0).float()
    torch.testing.assert_close(bricks(nodes), expected, atol=1e-5, rtol=0)


def test_bricks_are_the_same_with_any_number_of_threads(points, generator):
    positions = anywhere(points, generator, beyond=1.0)
    num_threads, results = torch.get_num_threads(), []
    try:
        for number in (1, 2):
            torch.set_num_threads(number)
            bricks = in_bricks(points, 0.1)
            results.append((bricks(positions), pull_of(bricks, positions)))
    finally:
        torch.set_num_threads(num_threads)
    torch.testing.assert_close(*results, atol=0, rtol=0)


def test_a_single_brick_in_a_batch_is_as_right_as_several(generator, monkeypatch):
    points = 3 * torch.rand(50, 3, generator=generator)
    results = []
    for batch in (1, 64):
        monkeypatch.setattr(brick_distance, "_batch_size", lambda device, size=batch: size)
        results.append(in_bricks(points, 0.1, 1.0)(points + 0.3))
    torch.testing.assert_close(*results, atol=0, rtol=0)


def test_stray_points_cost_the_bricks_around_them(points):
    strays = 1e4 * points.new_tensor([[1.0, 1.0, 0.0], [-1.0, 0.0, 0.5], [0.0, 0.0, -1.0]])
    # Ten cells and the nodes around them are in at most 4 bricks along each axis.
    both = torch.cat([points, strays])
    bricks = BrickDistance(both, 0.1, 1.0, max_cells=16**3 * (7**3 + 3 * 4**3))
    assert bricks(both).max() < math.sqrt(3) * 0.1
    near = strays + points.new_tensor([0.5, 0.0, 0.0])
    torch.testing.assert_close(bricks(near), brute_force(near, strays), atol=0.1, rtol=0)


def test_search_is_the_same_as_brute_force(points, generator):
    positions = anywhere(points, generator, beyond=5.0).requires_grad_()
    distances = NearestNeighborDistance(points)(positions)
    torch.testing.assert_close(distances, brute_force(positions, points))
    (gradient,) = torch.autograd.grad(distances.sum(), positions)
    landed = positions.detach() - gradient * distances.detach()[:, None]
    assert brute_force(landed, points).max() < 1e-4


# Its cells are made for half a metre; other reaches are a matter of the unit.
@pytest.mark.parametrize("reach_m", [0.3, 0.5, 2.0, 5.0])
@pytest.mark.parametrize("offset", [0.0, 900.0])
def test_search_in_cells_is_brute_force_up_to_its_reach(points, generator, reach_m, offset):
    points = points + offset
    target = in_cells(points, reach_m)
    positions = anywhere(points, generator, beyond=4 * reach_m).requires_grad_()
    distances = target(positions)
    exact = brute_force(positions.detach(), points)
    tolerance = {"atol": 3e-4 if offset else 1e-5, "rtol": 0}
    torch.testing.assert_close(distances.detach(), exact.clamp(max=reach_m), **tolerance)
    is_near = exact < reach_m - 1e-3
    assert is_near.sum() > 10
    assert (~is_near).sum() > 100
    weights = torch.rand(len(positions), generator=generator)
    (gradient,) = torch.autograd.grad((weights * distances).sum(), positions)
    gradient = gradient / weights[:, None]
    landed = (positions - gradient * distances[:, None]).detach()[is_near]
    assert brute_force(landed, points).max() < (1e-3 if offset else 1e-4)
    assert not gradient[exact > reach_m + 1e-3].any()


@pytest.mark.parametrize(
    ("lookup", "most"),
    [
        (transform, math.inf),
        (NearestNeighborDistance, math.inf),
        (in_bricks, REACH_M),
        (in_cells, REACH_M),
    ],
)
def test_positions_that_are_points_far_away_or_no_numbers(points, lookup, most):
    target = lookup(points)
    far = points.new_tensor([[1e7, 0.0, -1e7], [1e20, 0.0, -1e20]])
    positions = torch.cat([points, far]).requires_grad_()
    distances = target(positions)
    distances.sum().backward()
    assert distances[: len(points)].max() < math.sqrt(3) * CELL_M
    assert (distances[len(points) :] >= far[:, 0].clamp(max=most)).all()
    assert positions.grad.isfinite().all()
    for bad in (math.nan, math.inf):
        assert not target(points.new_tensor([[bad, 0.0, 0.0]])).isfinite().any()


def test_setting_chooses_the_kind_but_what_is_too_large_is_replaced(points, generator):
    # The search in cells is one of the CPU.
    cells = "bricks" if points.is_cuda else "cells"
    kinds = {"grid": "grid", "bricks": "bricks", "cells": cells, "tree": "tree"}
    for kind, chosen in kinds.items():
        assert distance_to(points, kind=kind).kind == chosen
    num_cells = math.prod(nodes_around(points, 0.1)[1])
    assert distance_to(points, kind="grid", max_cells=num_cells).kind == "grid"
    few = {"kind": "grid", "max_cells": num_cells - 1}
    assert distance_to(points, **few, truncation_m=0).kind == "tree"
    assert distance_to(points, **few).kind == "tree"
    # With 10 cells per metre and 10 m of height, 10 km need 10^9 cells and more.
    for far, replacement in ((1e4, "bricks"), (1e20, "tree")):
        both = torch.cat([points, points.new_tensor([[far, far, 0.0]])])
        target = distance_to(both, kind="grid")
        assert target.kind == replacement
        assert target(points).max() < math.sqrt(3) * 0.1
        assert distance_to(both, kind="grid", truncation_m=0).kind == "tree"
    # Points so far apart that each has bricks of its own, and a reach of very many cells.
    scattered = 1e5 * torch.rand(50_000, 3, generator=generator).to(points.device)
    assert distance_to(scattered, kind="bricks").kind == "tree"
    assert distance_to(points, kind="bricks", truncation_m=1000, cell_size_m=0.01).kind == "tree"


@pytest.mark.parametrize("kind", ["grid", "bricks", "cells", "tree"])
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
    if kind in ("grid", "tree"):
        far = torch.tensor([[300.0, 0.0, 0.0]], device=device)
        assert distance_to(origin, kind=kind, truncation_m=0)(far).item() == pytest.approx(300)


@pytest.mark.parametrize("kind", ["grid", "bricks", "cells", "tree"])
def test_distances_come_with_their_gradient(points, generator, kind):
    distance = distance_to(points, kind=kind, cell_size_m=CELL_M, truncation_m=REACH_M)
    positions = anywhere(points, generator, beyond=2 * REACH_M)
    distances, gradients = distance.with_gradient(positions)
    torch.testing.assert_close(distances, distance(positions), atol=0, rtol=0)
    torch.testing.assert_close(gradients, pull_of(distance, positions), atol=0, rtol=0)
    assert not distances.requires_grad
    assert 0 < (gradients != 0).any(dim=1).sum() < len(positions)
