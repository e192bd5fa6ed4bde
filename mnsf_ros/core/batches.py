# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Random rows to optimize on, and networks applied to many rows."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from mnsf_ros.core.compute_device import copy_to

# On a CPU few enough for the layers to stay in the cache of a core.
_ROWS_AT_ONCE = {"cpu": 4_096, "cuda": 262_144}


class Batches:
    """Random rows of a table (M, C), or all of them if the size is 0 or at least M.

    The generator is on the CPU, so that a GPU draws the same rows.
    """

    def __init__(self, rows: torch.Tensor, size: int, generator: torch.Generator) -> None:
        self._rows = rows
        self._size = size
        self._generator = generator
        self._loaded: torch.Tensor | None = None  # [T, size] rows of the next batches
        self._turn = torch.zeros(1, dtype=torch.int64, device=rows.device)

    @property
    def are_whole(self) -> bool:
        """Whether each batch has all rows, so that losses can be compared."""
        return not 0 < self._size < len(self._rows)

    def draw(self) -> torch.Tensor:
        """The next batch."""
        if self.are_whole:
            return self._rows
        if self._loaded is not None:
            indices = self._loaded.index_select(0, self._turn)[0]
            self._turn.add_(1)
            return self._rows.index_select(0, indices)
        return self._rows[self._next_indices().to(self._rows.device)]

    def _next_indices(self) -> torch.Tensor:
        return torch.randint(len(self._rows), (self._size,), generator=self._generator)

    def _load(self, indices: torch.Tensor, capacity: int) -> None:
        if self._loaded is None:
            shape = (capacity, self._size)
            self._loaded = torch.zeros(shape, dtype=torch.int64, device=self._rows.device)
        copy_to(self._loaded[: len(indices)], indices)
        self._turn.zero_()

    def unload(self) -> None:
        """Forgets the batches that `preload` has drawn."""
        self._loaded = None


def preload(sources: Sequence[Batches], number: int, capacity: int) -> None:
    """Draws the next batches of each source, so that `draw` does not need the host.

    They are the same as if drawn in turn, one of each source. Later calls use the same place of
    the device.

    Args:
        sources: The sources; whole ones are left as they are.
        number: Number of batches of each.
        capacity: The largest number of all calls until `unload`.
    """
    random = [source for source in sources if not source.are_whole]
    drawn = [[source._next_indices() for source in random] for _ in range(number)]
    for source, indices in zip(random, zip(*drawn, strict=True), strict=True):
        source._load(torch.stack(indices), capacity)


@torch.no_grad()
def evaluate(network: nn.Module, rows: torch.Tensor) -> torch.Tensor:
    """Applies a network to rows (N, C), in pieces that bound the memory; (N, 3)."""
    return torch.cat([network(part) for part in rows.split(_ROWS_AT_ONCE[rows.device.type])])
