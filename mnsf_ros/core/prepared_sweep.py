# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A sweep prepared for the estimate: its kept points, on the device, with its D."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import compute_device, on_device, on_host
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import fit_mask
from mnsf_ros.sweeps.sweep import Sweep


class PreparedSweep:
    """A prepared sweep. Built once, used as next, current and previous.

    Attributes:
        kept: (N,) bool, the points that fields are fitted to, see `fit_mask`.
        points: (M, 3) float32 on the device, metres, the kept points.
    """

    def __init__(self, sweep: Sweep, settings: Settings) -> None:
        """Chooses the points.

        Raises:
            SweepError: If too few points are left.
        """
        self._is_chosen = sweep.kept is not None
        self.kept = fit_mask(sweep, settings)
        self._xyz = sweep.xyz
        self._settings = settings.distance
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
