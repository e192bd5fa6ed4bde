# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Random batches, and networks applied piece by piece."""

from __future__ import annotations

import pytest
import torch

from mnsf_ros.core.batches import Batches, evaluate
from mnsf_ros.core.flow_field import Perceptron
from mnsf_ros.settings import FieldSettings


def table(num_rows, device="cpu"):
    """Rows (i, 10 i): each tells which one it is, and whether it is in one piece."""
    rows = torch.arange(num_rows, dtype=torch.float32, device=device)
    return torch.stack([rows, 10 * rows], dim=1)


@pytest.mark.parametrize("size", [0, 20, 21, 10_000])
def test_whole_batches_are_all_rows_in_order(size, device, generator):
    rows = table(20, device)
    batches = Batches(rows, size, generator)
    assert batches.are_whole
    assert torch.equal(batches.draw(), rows)


@pytest.mark.parametrize("size", [1, 7, 19])
def test_batch_has_rows_of_the_table(size, device, generator):
    batches = Batches(table(20, device), size, generator)
    assert not batches.are_whole
    for _ in range(10):
        batch = batches.draw()
        assert batch.shape == (size, 2)
        assert batch.device == table(1, device).device
        assert set(batch[:, 0].tolist()) <= set(range(20))
        assert torch.equal(batch[:, 1], 10 * batch[:, 0])


def test_every_row_has_its_turn(generator):
    batches = Batches(table(20), 5, generator)
    drawn = torch.cat([batches.draw() for _ in range(100)])[:, 0].tolist()
    assert set(drawn) == set(range(20))


def test_draws_differ_but_the_same_seed_gives_the_same_ones(device):
    first, again = (
        Batches(table(1000, device), 20, torch.Generator().manual_seed(3)) for _ in range(2)
    )
    draws = [first.draw() for _ in range(3)]
    assert not torch.equal(draws[0], draws[1])
    for draw in draws:
        assert torch.equal(draw, again.draw())


@pytest.mark.parametrize("num_rows", [0, 1, 16_384, 16_385, 40_000])
def test_pieces_give_the_same_as_the_whole(num_rows, device, generator):
    network = Perceptron(FieldSettings(1, 4), generator, 2).to(device)
    rows = torch.rand(num_rows, 2, device=device)
    flow = evaluate(network, rows)
    assert not flow.requires_grad
    torch.testing.assert_close(flow, network(rows).detach())
