# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A sweep prepared for the estimate: its kept points, on the device, with its D."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import compute_device, on_device, on_host
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.errors import SweepError
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import crop_mask, kept_mask
from mnsf_ros.sweeps.sweep import Sweep

_MIN_POINTS = 10


class PreparedSweep:
    """A prepared sweep. Built once, used as next, current and previous.

    Attributes:
        kept: (N,) bool, the points that fields are fitted to: those inside the crop, chosen by
            the caller or not ground.
        points: (M, 3) float32 on the device, metres, the kept points.
    """

    def __init__(self, sweep: Sweep, settings: Settings) -> None:
        """Chooses the points.

        Raises:
            SweepError: If too few points are left.
        """
        self._is_chosen = sweep.kept is not None
        self.kept = (
            kept_mask(sweep.xyz, settings)
            if sweep.kept is None
            else sweep.kept & crop_mask(sweep.xyz, settings.crop)
        )
        num_kept = int(np.count_nonzero(self.kept))
        if num_kept < _MIN_POINTS:
            choice = ", ground removal and the choice of points" if self._is_chosen else None
            raise SweepError(
                f"sweep {sweep.stamp_ns}: {num_kept} of {len(sweep)} points are left after crop"
                f"{choice or ' and ground removal'}, expected at least {_MIN_POINTS}"
            )
        self._xyz = sweep.xyz
        self._settings = settings.distance
        self._field = settings.field
        self._is_ego_motion_removed = settings.ego_motion.removed
        self.points = on_device(sweep.xyz[self.kept], compute_device(settings.compute))

    @cached_property
    def positions(self) -> torch.Tensor:
        """(P, 3) positions at which fields are evaluated: all points, or the kept ones if chosen.

        Networks do not extrapolate, so a cropped point takes the flow of the nearest place in the
        box around the kept points.
        """
        if self._is_chosen:
            return self.points
        low, high = self.points.min(dim=0).values, self.points.max(dim=0).values
        all_points = on_device(self._xyz, self.points.device)
        return torch.minimum(torch.maximum(all_points, low), high)

    @property
    def kept_positions(self) -> torch.Tensor:
        """(M,) indices of the kept points among `positions`, on the CPU."""
        if self._is_chosen:
            return torch.arange(len(self.points))
        return torch.from_numpy(self.kept).nonzero().view(-1)

    def everywhere(
        self, flow_at: Callable[[torch.Tensor], torch.Tensor], rows: torch.Tensor
    ) -> torch.Tensor:
        """Returns the flow at `positions`, (P, 3), of a function of rows (M, C) to (M, 3).

        With `field.cell_size_m` all positions in a cell have the flow of one of them; with
        `field.rest_is_static` points that are not kept are static.

        Args:
            flow_at: The function.
            rows: (P, C) its input for each position.
        """
        if self._places is None:
            return flow_at(rows)
        chosen, place_of = self._places
        found = flow_at(rows[chosen])
        return torch.cat([found, found.new_zeros(1, 3)])[place_of]

    @cached_property
    def _places(self) -> tuple[torch.Tensor, torch.Tensor] | None:
        """Rows of `positions` (Q,) at which functions are evaluated; None: all.

        And for each position the number of the row with its flow (P,); Q for static ones.
        """
        cell_size_m = self._field.cell_size_m
        rest_is_static = self._field.rest_is_static and self._is_ego_motion_removed
        if not cell_size_m and not rest_is_static:
            return None
        device, number = self.points.device, len(self.positions)
        chosen = torch.arange(number, device=device)
        if rest_is_static:
            chosen = self.kept_positions.to(device)
        first = cell_of = torch.arange(len(chosen), device=device)
        if cell_size_m:
            first, cell_of = _cells_of(self.positions[chosen], cell_size_m)
        place_of = torch.full((number,), len(first), device=device)
        place_of[chosen] = cell_of
        return chosen[first], place_of

    def whole(self, flow: torch.Tensor) -> NDArray[np.float32]:
        """Returns the flow (P, 3) at `positions` for all points (N, 3), NaN for others."""
        if not self._is_chosen:
            return on_host(flow)
        whole = np.full(self._xyz.shape, np.nan, dtype=np.float32)
        whole[self.kept] = on_host(flow)
        return whole

    @cached_property
    def distance(self) -> TargetDistance:
        """D(p, S) with this sweep as the target S."""
        return TargetDistance.to_points(self.points, self._settings)


def _cells_of(positions: torch.Tensor, cell_size_m: float) -> tuple[torch.Tensor, torch.Tensor]:
    """The first row of each cell with positions (Q,), and the cell of each position (P,)."""
    low = positions.min(dim=0).values
    # A millimetre: the number of cells must be an int64.
    cells = ((positions - low) / max(cell_size_m, 0.001)).long()
    _, ny, nz = cells.max(dim=0).values + 1
    flat = (cells[:, 0] * ny + cells[:, 1]) * nz + cells[:, 2]
    found, cell_of = flat.unique(return_inverse=True)
    rows = torch.arange(len(flat), device=flat.device)
    first = torch.full_like(found, len(flat)).scatter_reduce_(0, cell_of, rows, "amin")
    return first, cell_of


class SweepPreparation:
    """Prepares sweeps and keeps them while they are in the current triplet."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._prepared: dict[Sweep, PreparedSweep] = {}

    def prepare(self, *sweeps: Sweep) -> list[PreparedSweep]:
        """The prepared sweeps, in the order given; all others are forgotten."""
        self._prepared = {
            sweep: self._prepared.get(sweep) or PreparedSweep(sweep, self._settings)
            for sweep in sweeps
        }
        return [self._prepared[sweep] for sweep in sweeps]
