# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The linear field and NSFP's loss, against their definitions written out."""

import pytest
import torch

from mnsf_ros.errors import SweepError
from mnsf_ros.methods.baselines import ChamferDistance, KroneckerField
from mnsf_ros.settings import Settings

SETTINGS = Settings().changed({"linear.node_spacing_m": 2.0, "linear.sigma_m": 3.0}).linear
POINTS = torch.tensor([[-3.0, 0.5, 1.0], [5.0, 4.0, 2.5]])
# One node to spare: x from -6 to 8, y from -2 to 6, z from -2 to 6.
LOW, SHAPE = torch.tensor([-6.0, -2.0, -2.0]), (8, 5, 5)


@pytest.fixture
def field(generator, device):
    return KroneckerField(POINTS, SETTINGS, generator).to(device)


def weights_of(field):
    (weights,) = field.parameters()
    return weights


def slow_flow(field, node):
    """Weights times the Kronecker product of the codes of one node."""
    code = torch.ones(1)
    for number, size in zip(node, SHAPE, strict=True):
        places = 2.0 * torch.arange(size)
        all_codes = torch.exp(-((places[:, None] - places) ** 2) / (2 * 3.0**2))
        code = torch.kron(code, all_codes[number] / all_codes.norm(dim=1).max())
    return weights_of(field).detach().cpu().reshape(3, -1) @ code


def test_flow_at_the_nodes(field, device):
    assert weights_of(field).shape == (3, *SHAPE)
    for node in [(0, 0, 0), (3, 2, 1), (7, 4, 4), (1, 3, 0)]:
        position = (LOW + 2.0 * torch.tensor(node)).to(device)
        flow = field(position[None])[0]
        torch.testing.assert_close(flow.cpu(), slow_flow(field, node), atol=1e-5, rtol=1e-4)


def test_blended_between_the_nodes(field, device):
    corners = torch.cartesian_prod(*[torch.tensor([2, 3])] * 3)
    inside = torch.tensor([0.25, 0.5, 0.8])
    blend = torch.zeros(3)
    for corner in corners:
        share = torch.where(corner == 3, inside, 1 - inside).prod()
        blend += share * slow_flow(field, corner.tolist())
    position = (LOW + 2.0 * (2 + inside)).to(device)
    torch.testing.assert_close(field(position[None])[0].cpu(), blend, atol=1e-5, rtol=1e-4)


def test_outside_it_is_the_border(field, device):
    far = torch.tensor([[1e4, 1e4, -1e4]], device=device)
    torch.testing.assert_close(
        field(far)[0].cpu(), slow_flow(field, (7, 4, 0)), atol=1e-5, rtol=1e-4
    )


def test_total_variation_by_hand(field):
    # A field whose flow rises by 1 along x per node, found by solving for the weights.
    with torch.no_grad():
        weights_of(field).zero_()
    floor = 3 * 1e-5**0.5
    assert field.total_variation().item() == pytest.approx(floor, rel=1e-3)
    with torch.no_grad():
        weights_of(field)[0, 3, 2, 2] = 1.0
    flow = torch.stack(
        [
            torch.stack(
                [torch.stack([slow_flow(field, (i, j, k)) for k in range(5)]) for j in range(5)]
            )
            for i in range(8)
        ]
    )[..., 0]
    corner = flow[:-1, :-1, :-1]
    steps = [flow[1:, :-1, :-1], flow[:-1, 1:, :-1], flow[:-1, :-1, 1:]]
    lengths = sum((step - corner) ** 2 for step in steps).add(1e-5).sqrt()
    expected = lengths.mean().item() + 2 * 1e-5**0.5
    assert field.total_variation().item() == pytest.approx(expected, rel=1e-4)


def test_grid_too_large_for_memory_is_refused(generator):
    far = torch.tensor([[0.0, 0.0, 0.0], [1000.0, 1000.0, 1000.0]])
    with pytest.raises(
        SweepError, match=r"^the grid of the linear field would have 503 x 503 x 503"
    ):
        KroneckerField(far, SETTINGS, generator)


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
