# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Random batches of rows."""

from __future__ import annotations

import pytest
import torch

from mnsf_ros.core.batches import Batches


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


def test_batches_have_rows_of_the_table_and_every_row_has_its_turn(device, generator):
    batches = Batches(table(20, device), 5, generator)
    assert not batches.are_whole
    drawn = torch.cat([batches.draw() for _ in range(100)])
    assert drawn.shape == (500, 2)
    assert drawn.device == table(1, device).device
    assert set(drawn[:, 0].tolist()) == set(range(20))
    assert torch.equal(drawn[:, 1], 10 * drawn[:, 0])
