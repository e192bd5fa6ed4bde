# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The distance transform of a sweep in bricks that exist only within reach of its points.

Nodes and distances are those of `DistanceTransform`, clamped at the reach. Time and memory follow
the number of points, not the box around them. All is done by tensor operations, on CPU and CUDA.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import torch

from mnsf_ros.errors import MnsfError
from mnsf_ros.networks.distance_transform import nodes_around

# Cells of a brick along an axis. It has one node more, the first one of the next brick: all nodes
# around a position are in one brick.
_CELLS: Final = 15
_NODES: Final = _CELLS + 1
_PLANE: Final = _NODES**2

# Numbers of bricks along an axis have 21 bits: three of them fit into an int64.
_AXIS_BITS: Final = 21
_STEPS: Final = (1 << 2 * _AXIS_BITS, 1 << _AXIS_BITS, 1)

# Largest distance of nodes from the origin: float32 resolves half a cell there.
_MAX_NODE: Final = 2**23

# Bricks of one batch. What a batch of 32 reads and writes stays in the cache of a core, 50 kB for
# each; on CUDA it is enough for all multiprocessors.
_BATCH_OF_CORE: Final = 32
_BATCH_ON_CUDA: Final = 2048


class BrickLimitError(MnsfError):
    """The points need more bricks than allowed, or are too far from the origin."""


class BrickDistance:
    """Distances to a sweep up to a reach, interpolated trilinearly between the nodes."""

    kind = "bricks"

    def __init__(
        self, points: torch.Tensor, cell_size_m: float, reach_m: float, max_cells: int
    ) -> None:
        """Builds the transform to (N, 3) points, metres; distances beyond the reach count as it.

        Raises:
            BrickLimitError: It needs more cells, or points are too far from the origin.
        """
        self._cell_size_m, self._reach_m = cell_size_m, reach_m
        if not bool((points.abs() < _MAX_NODE * cell_size_m).all()):
            raise BrickLimitError(f"points more than {_MAX_NODE * cell_size_m:g} m from the origin")
        # A position within reach is between nodes that are farther by up to the diagonal of a cell.
        far = math.ceil((reach_m / cell_size_m + math.sqrt(3)) ** 2)
        # No brick has the number 0: there are positions beyond all bricks.
        margin = _CELLS * (math.isqrt(far) // _CELLS + 2)
        first, _ = nodes_around(points, cell_size_m)
        origin = points.new_tensor([node * cell_size_m for node in first], dtype=torch.float64)
        nodes = ((points.double() - origin) / cell_size_m).round().long() + margin
        self._origin = origin - margin * cell_size_m
        bricks = _Bricks.of_nodes(nodes, far, max_cells // _NODES**3)
        # After a pass along each axis, the axes of a brick are x, y, z again.
        for step in _STEPS:
            bricks = bricks.spread(step)
        self._bricks = bricks
        corners = [[[x + y + z for z in (0, 1)] for y in (0, _NODES)] for x in (0, _PLANE)]
        self._corners = torch.tensor(corners, device=points.device)

    def __call__(self, positions: torch.Tensor) -> torch.Tensor:
        """(M, 3) metres to (M,) metres, differentiable; the reach where there is no brick."""
        # float64: far from the origin, float32 has no digits left for the place in a cell.
        units = (positions.double() - self._origin) / self._cell_size_m
        floors = units.detach().floor()
        x, y, z = (units - floors).float().unbind(dim=1)  # 0..1, the place in the cell
        nodes = self._nodes(floors)[:, None, None, None] + self._corners
        squares = self._bricks.squares.view(-1)[nodes]  # [M, 2, 2, 2]
        along_xyz = squares.float().sqrt_().mul_(self._cell_size_m)
        along_yz = torch.lerp(along_xyz[:, 0], along_xyz[:, 1], x[:, None, None])
        along_z = torch.lerp(along_yz[:, 0], along_yz[:, 1], y[:, None])
        return torch.lerp(along_z[:, 0], along_z[:, 1], z).clamp(max=self._reach_m)

    def _nodes(self, floors: torch.Tensor) -> torch.Tensor:
        """Index of the first node of each cell among all nodes: (M, 3) to (M,)."""
        last = _CELLS * (2**_AXIS_BITS - 1)
        cells = floors.nan_to_num(0.0).clamp(0, last).long()
        bricks = cells.div(_CELLS, rounding_mode="trunc")
        x, y, z = (cells - _CELLS * bricks).unbind(dim=1)
        return ((self._bricks.rows(_key(bricks)) * _NODES + x) * _NODES + y) * _NODES + z


@dataclass(frozen=True)
class _Bricks:
    """Squared distances of nodes, in cells, before, between and after the passes."""

    keys: torch.Tensor  # (B,) int64, ascending, see `_key`; the first, -1, is of an empty brick
    squares: torch.Tensor  # (B, 16, 16, 16), at most `far`; the first axis is that of the next pass
    far: int  # the largest square; farther nodes do not matter
    max_bricks: int

    @classmethod
    def of_nodes(cls, nodes: torch.Tensor, far: int, max_bricks: int) -> "_Bricks":
        """The bricks that contain target nodes (N, 3).

        Raises:
            BrickLimitError: There are too many, or the ball around one node has too many.
        """
        _check_number(4 * math.isqrt(far) ** 3 // _NODES**3, max_bricks)
        bricks = nodes.div(_CELLS, rounding_mode="trunc")
        x, y, z = (nodes - _CELLS * bricks).unbind(dim=1)
        keys, rows = _key(bricks).unique(return_inverse=True)
        _check_number(len(keys), max_bricks)
        # A pass adds two squares: up to 127 cells, int16 holds the sum.
        dtype = torch.int16 if 2 * far < torch.iinfo(torch.int16).max else torch.int32
        shape = (len(keys) + 1, _NODES, _NODES, _NODES)
        squares = torch.full(shape, far, dtype=dtype, device=nodes.device)
        squares[rows + 1, x, y, z] = 0
        return cls(torch.cat([keys.new_tensor([-1]), keys]), squares, far, max_bricks)

    def rows(self, keys: torch.Tensor) -> torch.Tensor:
        """Rows of the bricks with these keys; 0, the empty brick, for those that do not exist."""
        rows = torch.searchsorted(self.keys, keys).clamp_(max=len(self.keys) - 1)
        return torch.where(self.keys[rows] == keys, rows, 0)

    def spread(self, step: int) -> "_Bricks":
        """One pass: the minimum of square plus squared offset, along the first axis.

        The last node of a brick along this axis, unknown before, is known afterwards. The axis
        becomes the last one. `step` is the difference between the keys of neighbours along it.

        Raises:
            BrickLimitError: There would be too many bricks.
        """
        width = math.isqrt(self.far - 1)
        num_beside = width // _CELLS + 1  # the last node needs one more than the first one
        beside = torch.arange(-num_beside, num_beside + 1, device=self.keys.device)
        keys = self._reached(beside, step)
        _check_number(len(keys), self.max_bricks)
        neighbours = self.rows(keys[:, None] + step * beside)  # [B, K]
        places = torch.arange(-width, _NODES + width, device=self.keys.device)
        brick = places.div(_CELLS, rounding_mode="floor")
        squares = self.squares.new_empty((len(keys), _NODES, _NODES, _NODES))
        batch = _batch_size(squares.device)
        for rows, result in zip(neighbours.split(batch), squares.split(batch), strict=True):
            slices = rows[:, brick + num_beside] * _NODES + places - _CELLS * brick  # [B, P]
            lines = self.squares.view(-1, _PLANE).index_select(0, slices.view(-1))
            lowest = _lowest(lines.view(*slices.shape, _PLANE), width)
            result.copy_(lowest.view(result.shape).permute(0, 2, 3, 1))
        return replace(self, keys=keys, squares=squares)

    def _reached(self, beside: torch.Tensor, step: int) -> torch.Tensor:
        """Keys of the bricks with a node that is nearer than `far` after a pass."""
        lows = self.squares[:, :_CELLS].flatten(2).amin(dim=2).int()  # [B, 15]
        own = torch.arange(_CELLS, device=beside.device)
        first = _CELLS * beside[:, None]
        gaps = torch.maximum(first - own, own - first - _CELLS).clamp_(min=0)  # [K, 15]
        is_reached = (lows[:, None] + gaps.int().square()).amin(dim=2) < self.far  # [B, K]
        keys = self.keys[:, None] + step * beside
        return torch.where(is_reached, keys, -1).unique()


def _lowest(lines: torch.Tensor, width: int) -> torch.Tensor:
    """Minimum over offsets up to a width: (B, 16 + 2 width, 256) to (B, 16, 256)."""
    windows = lines.unfold(1, _NODES, 1).movedim(-1, 2).unbind(dim=1)
    # A copy: a single brick is contiguous as it is, and is read again below.
    lowest = windows[width].clone(memory_format=torch.contiguous_format)
    farther = torch.empty_like(lowest)
    squares = torch.arange(width + 1).square().to(lines.dtype).unbind()
    for offset in range(1, width + 1):
        torch.minimum(windows[width - offset], windows[width + offset], out=farther)
        torch.minimum(lowest, farther.add_(squares[offset]), out=lowest)
    return lowest


def _key(bricks: torch.Tensor) -> torch.Tensor:
    """One number for each brick, from its numbers along x, y, z: (N, 3) to (N,)."""
    x, y, z = bricks.unbind(dim=1)
    return x * _STEPS[0] + y * _STEPS[1] + z * _STEPS[2]


def _check_number(number: int, max_bricks: int) -> None:
    if number > max_bricks:
        raise BrickLimitError(f"{number:,} bricks, expected at most {max_bricks:,}")


def _batch_size(device: torch.device) -> int:
    return _BATCH_ON_CUDA if device.type == "cuda" else _BATCH_OF_CORE * torch.get_num_threads()
