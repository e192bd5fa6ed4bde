"""Random rows to optimize on, and networks applied to many rows."""

from __future__ import annotations

import torch
from torch import nn

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

    @property
    def are_whole(self) -> bool:
        """Whether each batch has all rows, so that losses can be compared."""
        return not 0 < self._size < len(self._rows)

    def draw(self) -> torch.Tensor:
        """The next batch."""
        if self.are_whole:
            return self._rows
        indices = torch.randint(len(self._rows), (self._size,), generator=self._generator)
        return self._rows[indices.to(self._rows.device)]


@torch.no_grad()
def evaluate(network: nn.Module, rows: torch.Tensor) -> torch.Tensor:
    """Applies a network to rows (N, C), in pieces that bound the memory; (N, 3)."""
    return torch.cat([network(part) for part in rows.split(_ROWS_AT_ONCE[rows.device.type])])
