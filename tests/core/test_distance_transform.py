# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The grid of distances against brute force. Cells of 0.5 m: its nodes are exact in binary."""

from __future__ import annotations

import math

import pytest
import torch

from mnsf_ros.core.distance_transform import DistanceTransform, GridBox, distances_within

CELL_M = 0.5


def transform(points, cell_size_m=CELL_M):
    return DistanceTransform.from_points(points, GridBox.around(points, cell_size_m))


def nodes_of(box, device="cpu"):
    axes = [
        start + box.cell_size_m * torch.arange(count)
        for start, count in zip(box.origin, box.shape, strict=True)
    ]
    return torch.cartesian_prod(*axes).to(device)


def brute_force(positions, points):
    # Not torch.cdist: for many points it loses centimetres.
    return (positions[:, None] - points[None]).norm(dim=2).min(dim=1).values


@pytest.fixture
def points_on_nodes(generator, device):
    nodes = torch.randint(-6, 7, (40, 3), generator=generator)
    return (CELL_M * nodes * torch.tensor([2, 1, 1])).float().to(device)


@pytest.fixture
def points(generator, device):
    return (6 * torch.rand(60, 3, generator=generator) - torch.tensor([3.0, 1.0, 50.0])).to(device)


def anywhere(points, generator, beyond):
    """Positions in the box around the points and up to so many metres beyond it."""
    low, high = points.min(dim=0).values.cpu() - beyond, points.max(dim=0).values.cpu() + beyond
    return (low + (high - low) * torch.rand(2000, 3, generator=generator)).to(points.device)


def test_box_has_the_points_inside_and_two_cells_around_them():
    box = GridBox.around(torch.tensor([[0.6, -1.0, 2.0], [1.4, 3.0, 2.0]]), CELL_M)
    assert box.origin == (-0.5, -2.0, 1.0)
    # x: nodes -0.5 ... 2.5, y: -2.0 ... 4.0, z: 1.0 ... 3.0
    assert box.shape == (7, 13, 5)
    assert box.num_cells == 7 * 13 * 5


def test_box_of_a_single_point():
    assert GridBox.around(torch.tensor([[1.0, 1.0, 1.0]]), CELL_M).shape == (5, 5, 5)


@pytest.mark.parametrize("far", [1e7, 1e20])
def test_box_can_be_measured_without_being_built(far):
    box = GridBox.around(torch.tensor([[0.0, 0.0, 0.0], [far, 0.0, 0.0]]), 0.1)
    assert box.num_cells == pytest.approx(25 * far / 0.1, rel=1e-5)


def test_box_moves_with_the_points(points):
    box = GridBox.around(points, CELL_M)
    moved = GridBox.around(points + 4 * CELL_M, CELL_M)
    assert moved.shape == box.shape
    assert moved.origin == tuple(start + 4 * CELL_M for start in box.origin)


def test_exact_at_the_nodes(points_on_nodes):
    nodes = nodes_of(GridBox.around(points_on_nodes, CELL_M), points_on_nodes.device)
    distances = transform(points_on_nodes)(nodes)
    torch.testing.assert_close(distances, brute_force(nodes, points_on_nodes), atol=1e-4, rtol=1e-5)
    assert distances.max() > 4 * CELL_M


def test_cells_need_not_be_binary_fractions(generator):
    points = 0.1 * torch.randint(-20, 20, (30, 3), generator=generator)
    nodes = nodes_of(GridBox.around(points, 0.1))
    torch.testing.assert_close(
        transform(points, 0.1)(nodes), brute_force(nodes, points), atol=1e-4, rtol=1e-4
    )


@pytest.mark.parametrize("cell_size_m", [0.1, 0.5])
def test_between_the_nodes_wrong_by_less_than_a_cell_and_a_half(points, generator, cell_size_m):
    # At most a diagonal from the nodes of a cell, half a diagonal from a point to its node.
    positions = anywhere(points, generator, beyond=0.0)
    error = transform(points, cell_size_m)(positions) - brute_force(positions, points)
    assert error.abs().max() < 1.5 * math.sqrt(3) * cell_size_m
    assert error.abs().mean() < 0.5 * cell_size_m


def test_points_themselves_are_less_than_a_diagonal_away(points):
    assert transform(points)(points).max() < math.sqrt(3) * CELL_M


def test_outside_never_less_than_the_true_distance_to_a_point(generator, device):
    point = torch.tensor([[1.0, -2.0, 0.5]], device=device)
    positions = anywhere(point, generator, beyond=20.0)
    excess = transform(point)(positions) - brute_force(positions, point)
    assert excess.min() > -1e-4


def test_outside_less_than_the_true_distance_by_the_rounding_only(points, generator):
    positions = anywhere(points, generator, beyond=30.0)
    excess = transform(points)(positions) - brute_force(positions, points)
    assert excess.min() > -1.5 * math.sqrt(3) * CELL_M


@pytest.mark.parametrize("beyond", [2.0, 30.0, 1e4])
def test_outside_it_pulls_back(points, generator, beyond):
    positions = anywhere(points, generator, beyond)
    box = GridBox.around(points, CELL_M)
    low = points.new_tensor(box.origin)
    high = low + CELL_M * (points.new_tensor(box.shape) - 1)
    is_outside = ((positions < low) | (positions > high)).any(dim=1)
    positions = positions[is_outside].requires_grad_()
    assert len(positions) > 100
    distances = transform(points)
    (pull,) = torch.autograd.grad(distances(positions).sum(), positions)
    assert pull.norm(dim=1).min() > 0.5
    with torch.no_grad():
        gap = (positions - positions.clamp(low, high)).norm(dim=1, keepdim=True)
        closer = positions - pull / pull.norm(dim=1, keepdim=True) * torch.minimum(
            gap, gap.new_tensor(0.5)
        )
        assert (distances(closer) < distances(positions)).all()


@pytest.mark.parametrize("far", [1e7, 1e20])
def test_far_away_is_no_nan(points, far):
    position = torch.tensor([[far, 0.0, -far]], device=points.device, requires_grad=True)
    distance = transform(points)(position)
    distance.sum().backward()
    assert distance.item() >= far
    assert position.grad.isfinite().all()


def test_gradient_is_the_slope(points, generator):
    box = GridBox.around(points, CELL_M)
    node = torch.floor(anywhere(points, generator, beyond=0.0) / CELL_M) * CELL_M
    # Between 0.2 and 0.8 of a cell from its lower node, so that a small step stays inside it.
    offset = CELL_M * (0.2 + 0.6 * torch.rand(node.shape, generator=generator))
    positions = (node + offset.to(node.device)).requires_grad_()
    distances = DistanceTransform.from_points(points, box)
    (gradient,) = torch.autograd.grad(distances(positions).sum(), positions)
    step = 0.05 * CELL_M
    with torch.no_grad():
        for axis, unit in enumerate(torch.eye(3, device=points.device)):
            rise = distances(positions + step * unit) - distances(positions - step * unit)
            torch.testing.assert_close(gradient[:, axis], rise / (2 * step), atol=1e-3, rtol=0)


def test_no_gradient_at_a_point_is_no_nan(points_on_nodes):
    positions = points_on_nodes.clone().requires_grad_()
    transform(points_on_nodes)(positions).sum().backward()
    assert positions.grad.isfinite().all()


def test_points_far_from_the_origin(generator):
    points = 3 * torch.rand(20, 3, generator=generator) + 900.0
    error = transform(points, 0.1)(points)
    assert error.max() < math.sqrt(3) * 0.1


def test_position_that_is_no_number_has_a_distance_that_is_none(points):
    positions = torch.tensor([[math.nan, 0.0, 0.0]], device=points.device)
    assert not transform(points)(positions).isfinite().any()


@pytest.mark.parametrize("reach_m", [0.3, 1.0, 40.0])
@pytest.mark.parametrize("cell_size_m", [0.1, 0.5])
def test_erosion_is_exact_within_its_reach(points, cell_size_m, reach_m):
    box = GridBox.around(points, cell_size_m)
    whole = DistanceTransform.from_points(points, box)
    near = DistanceTransform(distances_within(points, box, reach_m), box)
    is_near = whole.distances <= reach_m + 2 * cell_size_m
    torch.testing.assert_close(near.distances[is_near], whole.distances[is_near])
    assert (near.distances[~is_near] > reach_m).all()
    positions = points + torch.rand_like(points)
    limit = torch.tensor(reach_m, device=points.device)
    torch.testing.assert_close(
        near(positions).minimum(limit), whole(positions).minimum(limit), atol=1e-5, rtol=0
    )


def test_erosion_around_a_single_point(device):
    point = torch.tensor([[1.0, 1.0, 1.0]], device=device)
    box = GridBox.around(point, CELL_M)
    distances = distances_within(point, box, 100.0)
    assert distances[2, 2, 2] == 0
    assert distances[0, 2, 4] == pytest.approx(2 * CELL_M * math.sqrt(2))
